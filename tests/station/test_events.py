"""Events come without gaps, and a late joiner misses nothing."""

from __future__ import annotations

import json

import zmq

from daemon.client import Client
from tests.station.rig import Rig


def test_events_have_no_gaps_and_results_can_be_replayed(rig: Rig, client: Client) -> None:
    context = zmq.Context()
    socket = context.socket(zmq.SUB)
    socket.subscribe("")
    socket.connect(rig.events)
    try:
        assert socket.poll(10_000), "a heartbeat comes by itself"
        client.job("place", test_point="TP1", theta_deg=0.0)
        result = client.job("correct", test_point="TP1")
        seqs, states, published = [], [], None
        while published is None:
            assert socket.poll(10_000)
            topic, body = socket.recv_multipart()
            event = json.loads(body)
            assert event["topic"] == topic.decode()
            assert {"seq", "time", "station", "v"} <= event.keys()
            seqs.append(event["seq"])
            if event["topic"] == "state":
                states.append(event["state"])
            if event["topic"] == "result" and event["id"] == result.id:
                published = event
        assert seqs == list(range(seqs[0], seqs[0] + len(seqs)))
        assert states[-1] == "idle"
        assert {"triggered", "look"} <= set(states)
        assert published["seq"] == result.seq
        replay = client.request("results", since=result.seq)["results"]
        assert [r["id"] for r in replay][:1] == [result.id]
        snapshot = client.request("snapshot")
        assert snapshot["last_result"]["id"] == result.id
        assert snapshot["next_seq"] > result.seq
    finally:
        socket.close(linger=0)
        context.term()


def test_a_report_is_added_up(client: Client) -> None:
    before = client.request("snapshot")["touches"]
    assert client.request("report", touches=20)["touches"] == before + 20
