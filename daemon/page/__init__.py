"""Operator's page: a process of its own that shows a station in a browser and takes orders from people.

It speaks to the daemon over ZeroMQ, as any client does: nothing here is imported by the daemon, and killing the page
touches no job. Start with `app`; what a browser sees is `mirror`, who may do what is `people` and `orders`.
"""
