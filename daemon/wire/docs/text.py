"""Plain sentences of the page of the wire; the tables between them are made from rows and models."""

from daemon.wire.limits import GLANCE_BYTES

INTRO = """\
# The wire

Made by `reprobe schema --out doc` from the models the daemon itself uses; not written by hand.

Two ZeroMQ sockets. The **control** socket (ROUTER) takes one JSON object in one frame and answers with one: a plain
REQ socket of any language does, and so does DEALER, which may have many requests under way and finds its answers by
`id`. The **event** socket (PUB) sends two frames, the topic and one JSON object. Lengths are um, angles degrees,
times ms, as the names say. Unknown fields of a request are refused by name. JSON Schemas of all of it lie in
`schema/`.
"""

VERSIONS = """\
## Versions

Requests carry `"v"`; replies and events carry the version they are written in. A version the daemon does not speak is
refused (`unsupported_version`), and the refusal lists those it does; `describe` without `v` lists them too. Within a
version only this may be added: operations, optional fields of requests, fields of replies and events, topics, error
codes, outcomes, and words in fields that list words. A client ignores what it does not know. Nothing is taken away,
renamed or given another meaning or unit within a version; codes and names of errors stay for ever.
"""

JOBS = """\
## Jobs

{jobs} are jobs. Their `id` is the caller's idempotency key: the
same request with the same id again gets the same answer, whoever asks and however often, and moves nothing; another
request with that id is refused (`id_reused`). `wait` and `deadline_ms` are no part of what is asked. One job runs at
a time; the others wait, and the clients get their turn one after the other, each with its oldest job. How many may
wait is bounded, for one client and for all; beyond that a job is refused with `busy`, which names both bounds.
Without `wait` the reply says that the job was taken; its end comes as the event `result`, and `result` asks for it. A
job that was taken has exactly one result, also if the daemon is killed in the middle of it: then it is `interrupted`.
"""

ASKING = f"""\
## Waiting for an answer

A request that was on its way when the daemon was killed is lost, and so is an answer: a client waits with a time-out,
some seconds, and never without. A REQ socket that had no answer can send nothing else: close it (`LINGER` 0), connect
another, and send the same request again, a job with the same `id`. A job that still runs is then waited for, one that
has ended is answered with its result, one that the daemon never heard of is taken now; none is done twice. What is no
job may be sent again as it is, but for `report`, whose `touches` would be counted twice: ask `snapshot` first.

Any request may carry a `tag`; its answer, good or bad, carries the same. So a DEALER tells the answers of requests that
have no `id` apart, such as `status`, and a late answer from that to a later request. A message that is not read at all
(no JSON, too large, too many values) has none. What is refused for asking too fast (`rate_limited`), or with a key that
was taken back, has its `tag` and `id` up to {GLANCE_BYTES} bytes, and none beyond. Types are strict: `true` and
`"5000"` are no numbers, `"yes"` is no boolean.
"""

LATE = """\
## Coming late, and being slow

Every event has a number, `seq`, without gaps over all topics. Whoever comes late subscribes first, then asks
`snapshot`: it holds the state, the last result and `next_seq`. Events from that number on come after it or are in it
already; those below are in it. Results and alerts are kept: whoever missed some, because it came late, was slow or
the daemon was away, asks `results` and `alerts` with `since`, the first number it has not seen. Who subscribes to
some topics only sees gaps that are none: `heartbeat` carries the newest number.

For a subscriber that does not read, a thousand events are held; beyond that it loses events and sees it by the gap.
It never holds up the daemon. A client that does not read its answers loses them in the same way.
"""

KEYS = """\
## Keys and roles

On loopback and ipc a client needs no key, and its role is the configuration's (`api.role`). With `api.curve` both
sockets are CURVE servers: a client comes with the file that `reprobe keys new` wrote for it (`public`, `secret`, and
`server`, the station's public key; all Z85). A key that is not on the list never gets beyond the handshake. The role
belongs to the key and is looked up with each message: a key taken back is refused (`key_revoked`) also on a
connection that is open, and its subscription ends. A routable address is not bound without CURVE.
"""
