-- One view for each question a fleet is asked. psql and dashboards read these, and no table.

-- The newest record of each thing, for what changes is told again.
CREATE VIEW newest AS
SELECT DISTINCT ON (r.station, r.kind, r.item) r.*, s.site, s.line, s.name AS station_name
FROM records r JOIN stations s ON s.id = r.station
WHERE r.item IS NOT NULL
ORDER BY r.station, r.kind, r.item, r.journal DESC, r.seq DESC;

-- Lower end of the 95 % interval of a share (Wilson 1927): 1 of 3 does not lead a list of the worst.
CREATE FUNCTION share_at_least(hits bigint, trials bigint) RETURNS double precision
LANGUAGE sql IMMUTABLE AS $$
    SELECT CASE WHEN trials = 0 THEN 0 ELSE
        (p + 1.9208 / n - 1.96 * sqrt(p * (1 - p) / n + 0.9604 / (n * n))) / (1 + 3.8416 / n) END
    FROM (SELECT trials::double precision AS n, hits::double precision / nullif(trials, 0) AS p) AS s
$$;

-- Which station drifts, which stands apart from its sisters: the error found by the first look, by day.
CREATE VIEW station_drift AS
WITH daily AS (
    SELECT s.site, s.line, s.name AS station, r.board, date_trunc('day', r.received_at) AS day, count(*) AS looks,
           percentile_cont(0.5) WITHIN GROUP (ORDER BY r.error_before_um) AS median_um,
           stddev_samp(r.error_before_um) AS spread_um
    FROM records r JOIN stations s ON s.id = r.station
    WHERE r.error_before_um IS NOT NULL
    GROUP BY s.site, s.line, s.name, r.board, date_trunc('day', r.received_at)
), sisters AS (
    SELECT board, day, percentile_cont(0.5) WITHIN GROUP (ORDER BY median_um) AS sisters_um, count(*) AS stations
    FROM daily GROUP BY board, day
)
SELECT d.*, m.sisters_um, m.stations, d.median_um - m.sisters_um AS apart_um
FROM daily d JOIN sisters m ON m.day = d.day AND m.board IS NOT DISTINCT FROM d.board;

-- False opens: points that were no pass at the first touch and good in the end, and what cured them. Shifts of 8 h, UTC.
CREATE VIEW false_opens AS
SELECT site, line, date_trunc('day', received_at) AS day, (extract(hour FROM received_at) / 8)::int AS shift, needle,
       count(*) AS points, count(*) FILTER (WHERE outcome = 'pass_recovered') AS false_opens,
       count(*) FILTER (WHERE outcome = 'open_confirmed') AS true_opens,
       count(*) FILTER (WHERE recovered_by = 'look') AS by_look, count(*) FILTER (WHERE recovered_by = 'pump') AS by_pump,
       count(*) FILTER (WHERE recovered_by = 'reference') AS by_reference,
       count(*) FILTER (WHERE recovered_by = 'second_site') AS by_second_site
FROM newest WHERE kind = 'point' AND outcome <> 'not_tested'
GROUP BY site, line, date_trunc('day', received_at), (extract(hour FROM received_at) / 8)::int, needle;

-- Worst pads of a board design over all stations: no pass at the first touch.
CREATE VIEW worst_pads AS
SELECT board, point, count(*) AS tests, count(*) FILTER (WHERE missed) AS misses,
       count(DISTINCT station) AS stations, count(DISTINCT station) FILTER (WHERE missed) AS stations_missing,
       share_at_least(count(*) FILTER (WHERE missed), count(*)) AS miss_rate_at_least
FROM (SELECT *, outcome NOT IN ('pass_first', 'fail') AS missed FROM newest
      WHERE kind = 'point' AND outcome <> 'not_tested') AS tested
GROUP BY board, point;

-- How long does a needle last: touches since it was taught, by needle.
CREATE VIEW needle_life AS
SELECT site, line, station_name AS station, needle, tip, count(*) AS touches, min(received_at) AS first_touch,
       max(received_at) AS last_touch, avg(value) FILTER (WHERE outcome = 'pass') AS mean_value
FROM newest WHERE kind = 'touch'
GROUP BY site, line, station_name, needle, tip;

-- Which software and configuration where, since when.
CREATE VIEW software AS
SELECT DISTINCT ON (r.station) s.site, s.line, s.name AS station, r.program, r.configuration, r.board, r.needle, r.tip,
       r.received_at AS last_record
FROM records r JOIN stations s ON s.id = r.station
WHERE r.program IS NOT NULL
ORDER BY r.station, r.journal DESC, r.seq DESC;

-- Everything of one board, in any line: WHERE board_id = 'B-000117'.
CREATE VIEW board_history AS
SELECT r.board_id, s.site, s.line, s.name AS station, r.received_at, r.at, r.kind, r.op, r.board, r.point, r.outcome,
       r.ok, r.recovered_by, r.cause, r.error_before_um, r.value, r.needle, r.job, r.journal, r.seq,
       coalesce(r.body, w.body) AS body
FROM records r JOIN stations s ON s.id = r.station
LEFT JOIN recent w ON w.journal = r.journal AND w.seq = r.seq AND w.received_at = r.received_at
WHERE r.board_id IS NOT NULL;

-- Who is silent, faulted, alarmed now.
CREATE VIEW stations_now AS
SELECT s.site, s.line, s.name AS station, coalesce(t.online, false) AS online, t.state, t.fault, t.alerts, t.program,
       t.at AS said_at, j.last_record
FROM stations s LEFT JOIN states t ON t.station = s.id
LEFT JOIN LATERAL (SELECT max(received_at) AS last_record FROM records WHERE station = s.id) AS j ON true;

-- Is it the board, the needle, or the station: this point on other stations, other points on this station.
CREATE VIEW who_is_to_blame AS
WITH tested AS (
    SELECT station_name AS station, board, point, count(*) AS tests,
           count(*) FILTER (WHERE outcome NOT IN ('pass_first', 'fail')) AS misses
    FROM newest WHERE kind = 'point' AND outcome <> 'not_tested' GROUP BY station_name, board, point
)
SELECT here.station, here.board, here.point, here.tests, here.misses,
       there.tests AS tests_elsewhere, there.misses AS misses_elsewhere,
       beside.tests AS tests_of_other_points, beside.misses AS misses_of_other_points,
       CASE WHEN share_at_least(here.misses, here.tests) <= 0.05 THEN 'nobody'
            WHEN share_at_least(there.misses, there.tests) > 0.05 THEN 'board'
            WHEN share_at_least(beside.misses, beside.tests) > 0.05 THEN 'needle or station'
            ELSE 'this point at this station' END AS suspect
FROM tested here
CROSS JOIN LATERAL (SELECT coalesce(sum(tests), 0)::bigint AS tests, coalesce(sum(misses), 0)::bigint AS misses FROM tested o
    WHERE o.station <> here.station AND o.board IS NOT DISTINCT FROM here.board AND o.point = here.point) AS there
CROSS JOIN LATERAL (SELECT coalesce(sum(tests), 0)::bigint AS tests, coalesce(sum(misses), 0)::bigint AS misses FROM tested o
    WHERE o.station = here.station AND (o.board IS DISTINCT FROM here.board OR o.point <> here.point)) AS beside;

-- Holes: numbers that left no record.
CREATE VIEW lost_records AS
SELECT s.site, s.line, s.name AS station, j.journal, r.received_at, (r.body ->> 'from_seq')::bigint AS from_seq,
       (r.body ->> 'to_seq')::bigint AS to_seq
FROM records r JOIN stations s ON s.id = r.station JOIN journals j ON j.id = r.journal
WHERE r.kind = 'lost';
