"""An alert is news once, gets worse once, is acknowledged by a person, and is news again when it goes."""

import json
from dataclasses import replace

from daemon.maintenance.alerts import ActiveAlerts, Alert, AlertNews
from daemon.maintenance.types import Finding

FOUND = Finding("one point far off", 98.0, 119.0, 114.0, "warning", 4000, "t0", ("98 after 4100 touches (job-1)",))


def _find(alerts: ActiveAlerts, finding: Finding = FOUND, at: str = "t1") -> AlertNews | None:
    return alerts.find("light_white", "light", "the white ring's brightness", "levels", "clean it", finding, at)


def test_it_is_raised_once_and_brought_up_to_date_in_silence() -> None:
    alerts = ActiveAlerts()
    raised = _find(alerts)
    assert raised is not None
    assert raised.body["raised"] is True
    assert raised.body["change"] == "raised"
    assert "98 levels, usually 119, limit 114" in raised.body["message"]
    assert _find(alerts, replace(FOUND, figure=97.0), "t2") is None
    standing = alerts.standing["light_white"]
    assert (standing.figure, standing.raised_at, standing.updated_at) == (97.0, "t1", "t2")


def test_the_same_again_changes_nothing() -> None:
    alerts = ActiveAlerts()
    _find(alerts)
    before = alerts.standing["light_white"]
    _find(alerts, at="t9")
    assert alerts.standing["light_white"] is before


def test_getting_worse_is_news_once() -> None:
    alerts = ActiveAlerts()
    _find(alerts)
    serious = replace(FOUND, figure=60.0, severity="serious")
    worse = _find(alerts, serious)
    assert worse is not None
    assert worse.change == "worse"
    assert _find(alerts, replace(serious, figure=59.0)) is None


def test_an_acknowledgement_stays_while_it_stands() -> None:
    alerts = ActiveAlerts()
    _find(alerts)
    assert alerts.acknowledge("light_white", "Kim", "ring ordered", "t3") is not None
    _find(alerts, replace(FOUND, figure=90.0), "t4")
    assert alerts.standing["light_white"].acknowledged == {"by": "Kim", "at": "t3", "note": "ring ordered"}
    assert alerts.acknowledge("noise", "Kim", "", "t3") is None


def test_it_is_cleared_once() -> None:
    alerts = ActiveAlerts()
    _find(alerts)
    cleared = alerts.clear("light_white", "t5")
    assert cleared is not None
    assert cleared.body["raised"] is False
    assert alerts.clear("light_white", "t6") is None
    assert alerts.standing == {}


def test_it_is_kept_as_json_and_comes_back() -> None:
    alerts = ActiveAlerts()
    _find(alerts)
    alert = alerts.standing["light_white"]
    assert Alert.from_dict(json.loads(json.dumps(alert.to_dict()))) == alert
