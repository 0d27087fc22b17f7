"""`reprobe watch`: the daemon live on a terminal, or its events line by line for pipes and machines."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, Any

import typer
from rich.console import RenderableType
from rich.live import Live

from daemon.cli.formatting import gist
from daemon.cli.output import DEFAULT_ENDPOINT, AsJson, Endpoint, answered, err, out, say_json
from daemon.cli.watch_view import WatchView
from daemon.client import Client, NoAnswer, NotLetIn, Refused, Subscription, listen
from daemon.domain.results import JobResult

app = typer.Typer()
TOPICS = ("state", "result", "alert", "progress", "contact", "log")
ASK_WITHIN_S, TURN_S, REFRESH_S = 1.0, 0.25, 5.0
NO_PAST_ALERT = 2**62
"""No alert has so high a number: those that stand are asked for, not those that were."""
RECENT_EVENTS = 300
"""Results among so many last events are shown at the beginning."""


@app.command()
def watch(
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    topic: Annotated[list[str] | None, typer.Option(help="With --lines: only these topics.")] = None,
    count: Annotated[int, typer.Option(help="With --lines: end after so many events; 0 goes on.")] = 0,
    lines: Annotated[bool, typer.Option("--lines", help="Print events line by line.")] = False,
    as_json: AsJson = False,
) -> None:
    """Show the daemon live, until Ctrl-C: state, job, results, alerts, links. Line by line when piped."""
    with suppress(KeyboardInterrupt):
        if lines or as_json or topic or count or not out.is_terminal:
            _print_lines(endpoint, tuple(topic) if topic else TOPICS, count, as_json=as_json)
        else:
            view = WatchView(endpoint=endpoint)

            def drawn() -> RenderableType:
                return view.render(time.monotonic(), out.width, out.height)

            with answered(), Live(drawn(), console=out, auto_refresh=False) as live:
                follow(endpoint, view, lambda: live.update(drawn(), refresh=True))
    err.print("[dim]no longer listening[/]")


def _print_lines(endpoint: str, topics: tuple[str, ...], count: int, *, as_json: bool) -> None:
    with answered(), Client(endpoint) as client:
        events = client.request("describe")["events"]
    for n, event in enumerate(listen(events, topics), start=1):
        if as_json:
            say_json(event)
        else:
            out.print(f"[dim]{event['time']} {event['seq']:>6}[/] {event['topic']:<9} {gist(event)}", highlight=False)
        if n == count:
            return


def follow(endpoint: str, view: WatchView, shown: Callable[[], Any]) -> None:
    """Keep a view up to date until interrupted; `shown` is called after each change and several times a second.

    A daemon that is not there, or goes and comes back, is waited for; what was missed meanwhile is asked for.
    """
    with Client(endpoint, timeout_s=ASK_WITHIN_S) as client:
        while (events := _ask(client, "describe")) is None:
            shown()
        with Subscription(events["events"]) as heard:
            refresh(client, view)
            refresh(client, view, since=max(0, (view.next_seq or 0) - RECENT_EVENTS))
            asked_s = time.monotonic()
            while True:
                event = heard.next(TURN_S)
                expected = view.next_seq
                stale = event is not None and view.take(event, time.monotonic())
                if stale or time.monotonic() - asked_s > REFRESH_S:
                    refresh(client, view, since=expected if stale else None)
                    asked_s = time.monotonic()
                shown()


def refresh(client: Client, view: WatchView, since: int | None = None) -> None:
    """Ask for the whole picture, with the alerts that stand, and for the results that were missed."""
    snapshot, alerts = _ask(client, "snapshot"), _ask(client, "alerts", since=NO_PAST_ALERT, limit=1)
    if snapshot is not None:
        if alerts is not None:
            snapshot["alerts"] = alerts["standing"]
        view.take_snapshot(snapshot, time.monotonic())
    if since is not None and (replay := _ask(client, "results", since=since)) is not None:
        for result in replay["results"]:
            view.take_result(JobResult.model_validate(result))


def _ask(client: Client, op: str, **fields: Any) -> dict[str, Any] | None:
    try:
        return client.request(op, **fields)
    except NotLetIn:
        raise  # waiting will not change it
    except (NoAnswer, Refused):
        return None
