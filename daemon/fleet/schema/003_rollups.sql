-- Rollups: what is asked of the whole fleet over years is counted once, by hour of receipt, and kept for ever.
-- `roll_up` counts anew each hour that has news: a record that is told again moves from its first hour to its last.

CREATE INDEX records_of_item ON records (journal, kind, item, seq);
CREATE TABLE rolled (journal bigint PRIMARY KEY REFERENCES journals, seq bigint NOT NULL);
COMMENT ON TABLE rolled IS 'up to which number the records of a journal are counted';

CREATE TABLE points_by_hour (
    hour timestamptz NOT NULL, station integer NOT NULL REFERENCES stations, board text, needle text, point text,
    tests bigint NOT NULL, misses bigint NOT NULL, false_opens bigint NOT NULL, true_opens bigint NOT NULL,
    by_look bigint NOT NULL, by_pump bigint NOT NULL, by_reference bigint NOT NULL, by_second_site bigint NOT NULL
);
CREATE INDEX points_by_hour_of_station ON points_by_hour (station, hour);
CREATE INDEX points_by_hour_of_board ON points_by_hour (board, point);
CREATE TABLE looks_by_hour (
    hour timestamptz NOT NULL, station integer NOT NULL REFERENCES stations, board text, sector integer,
    errors_um double precision[] NOT NULL
);
CREATE INDEX looks_by_hour_of_station ON looks_by_hour (station, hour);
COMMENT ON COLUMN looks_by_hour.sector IS 'of the head''s angle: 45 degrees, 0 from 0 on; null where it was not told';
COMMENT ON COLUMN looks_by_hour.errors_um IS 'what each first look found';
CREATE TABLE touches_by_hour (
    hour timestamptz NOT NULL, station integer NOT NULL REFERENCES stations, needle text, tip text,
    touches bigint NOT NULL, first_touch timestamptz NOT NULL, last_touch timestamptz NOT NULL,
    passed_value double precision, passed bigint NOT NULL
);
CREATE INDEX touches_by_hour_of_station ON touches_by_hour (station, hour);
COMMENT ON COLUMN touches_by_hour.passed_value IS 'sum over the touches that were read and not called bad';

-- To be called in a transaction that sees one state of the database (REPEATABLE READ). Returns how many hours it counted.
-- LATERAL with OFFSET 0: few rows of many are wanted, in this order by index, whatever a planner without counts thinks.
CREATE FUNCTION roll_up() RETURNS bigint LANGUAGE plpgsql AS $$
DECLARE hours bigint;
BEGIN
    PERFORM pg_advisory_xact_lock(hashtext('reprobe rollups'));
    CREATE TEMP TABLE rolling ON COMMIT DROP AS
        SELECT j.id AS journal, coalesce(d.seq, 0) AS after, j.stored_seq AS upto
        FROM journals j LEFT JOIN rolled d ON d.journal = j.id WHERE j.stored_seq > coalesce(d.seq, 0);
    CREATE TEMP TABLE dirty ON COMMIT DROP AS
        SELECT DISTINCT o.station, date_trunc('hour', o.received_at, 'UTC') AS hour
        FROM rolling g
        CROSS JOIN LATERAL (SELECT n.kind, n.item FROM records n WHERE n.journal = g.journal AND n.seq > g.after
            AND n.seq <= g.upto AND n.kind IN ('point', 'touch', 'result') OFFSET 0) AS n
        CROSS JOIN LATERAL (SELECT r.station, r.received_at FROM records r WHERE r.journal = g.journal
            AND r.kind = n.kind AND r.item = n.item OFFSET 0) AS o;
    GET DIAGNOSTICS hours = ROW_COUNT;
    -- A record that is told again comes later; a day is left for a clock that was set back.
    CREATE TEMP TABLE told ON COMMIT DROP AS
        SELECT d.hour, r.*
        FROM dirty d
        CROSS JOIN LATERAL (SELECT * FROM records r WHERE r.station = d.station AND r.kind IN ('point', 'touch', 'result')
            AND r.received_at >= d.hour AND r.received_at < d.hour + interval '1 hour' OFFSET 0) AS r
        WHERE r.item IS NULL OR r.seq = (SELECT max(n.seq) FROM records n WHERE n.journal = r.journal AND n.kind = r.kind
            AND n.item = r.item AND n.received_at > d.hour - interval '1 day');

    DELETE FROM points_by_hour p USING dirty d WHERE p.station = d.station AND p.hour = d.hour;
    INSERT INTO points_by_hour
        SELECT hour, station, board, needle, point, count(*), count(*) FILTER (WHERE outcome NOT IN ('pass_first', 'fail')),
               count(*) FILTER (WHERE outcome = 'pass_recovered'), count(*) FILTER (WHERE outcome = 'open_confirmed'),
               count(*) FILTER (WHERE recovered_by = 'look'), count(*) FILTER (WHERE recovered_by = 'pump'),
               count(*) FILTER (WHERE recovered_by = 'reference'), count(*) FILTER (WHERE recovered_by = 'second_site')
        FROM told WHERE kind = 'point' AND outcome <> 'not_tested' GROUP BY hour, station, board, needle, point;
    DELETE FROM looks_by_hour l USING dirty d WHERE l.station = d.station AND l.hour = d.hour;
    INSERT INTO looks_by_hour
        SELECT hour, station, board, floor((theta_deg - 360 * floor(theta_deg / 360)) / 45)::int AS sector,
               array_agg(error_before_um ORDER BY journal, seq)
        FROM told WHERE error_before_um IS NOT NULL GROUP BY hour, station, board, sector;
    DELETE FROM touches_by_hour t USING dirty d WHERE t.station = d.station AND t.hour = d.hour;
    INSERT INTO touches_by_hour
        SELECT hour, station, needle, tip, count(*), min(received_at), max(received_at),
               sum(value) FILTER (WHERE coalesce(outcome, 'pass') = 'pass'),
               count(value) FILTER (WHERE coalesce(outcome, 'pass') = 'pass')
        FROM told WHERE kind = 'touch' GROUP BY hour, station, needle, tip;

    INSERT INTO rolled SELECT journal, upto FROM rolling
        ON CONFLICT (journal) DO UPDATE SET seq = excluded.seq;
    RETURN hours;
END $$;

DROP VIEW station_drift, false_opens, worst_pads, needle_life, who_is_to_blame, newest;

-- The newest record of each thing, for what changes is told again. Jobs and runs go on in the next journal; a number
-- that a journal gave is another thing in another one, for a file that was lost begins anew.
CREATE VIEW newest AS
SELECT DISTINCT ON (r.station, r.kind, r.item, CASE WHEN r.kind IN ('result', 'run') THEN 0 ELSE r.journal END)
       r.*, s.site, s.line, s.name AS station_name
FROM records r JOIN stations s ON s.id = r.station
WHERE r.item IS NOT NULL
ORDER BY r.station, r.kind, r.item, CASE WHEN r.kind IN ('result', 'run') THEN 0 ELSE r.journal END,
         r.journal DESC, r.seq DESC;

-- Which station drifts, which stands apart from its sisters: the error found by the first look, by day (UTC).
CREATE VIEW station_drift AS
WITH daily AS (
    SELECT s.site, s.line, s.name AS station, l.board, date_trunc('day', l.hour, 'UTC') AS day, count(*) AS looks,
           percentile_cont(0.5) WITHIN GROUP (ORDER BY e.um) AS median_um, stddev_samp(e.um) AS spread_um
    FROM looks_by_hour l CROSS JOIN LATERAL unnest(l.errors_um) AS e(um) JOIN stations s ON s.id = l.station
    GROUP BY s.site, s.line, s.name, l.board, date_trunc('day', l.hour, 'UTC')
), sisters AS (
    SELECT board, day, percentile_cont(0.5) WITHIN GROUP (ORDER BY median_um) AS sisters_um, count(*) AS stations
    FROM daily GROUP BY board, day
)
SELECT d.*, m.sisters_um, m.stations, d.median_um - m.sisters_um AS apart_um
FROM daily d JOIN sisters m ON m.day = d.day AND m.board IS NOT DISTINCT FROM d.board;

-- At which angle of the head: one that slipped misses in some sectors only.
CREATE VIEW drift_by_angle AS
SELECT s.site, s.line, s.name AS station, l.board, date_trunc('day', l.hour, 'UTC') AS day, 45 * l.sector AS from_deg,
       count(*) AS looks, percentile_cont(0.5) WITHIN GROUP (ORDER BY e.um) AS median_um, stddev_samp(e.um) AS spread_um
FROM looks_by_hour l CROSS JOIN LATERAL unnest(l.errors_um) AS e(um) JOIN stations s ON s.id = l.station
WHERE l.sector IS NOT NULL
GROUP BY s.site, s.line, s.name, l.board, date_trunc('day', l.hour, 'UTC'), l.sector;

-- False opens: points that were no pass at the first touch and good in the end, and what cured them. Shifts of 8 h, UTC.
CREATE VIEW false_opens AS
SELECT s.site, s.line, date_trunc('day', p.hour, 'UTC') AS day,
       floor(extract(hour FROM p.hour AT TIME ZONE 'UTC') / 8)::int AS shift, p.needle,
       sum(p.tests)::bigint AS points, sum(p.false_opens)::bigint AS false_opens, sum(p.true_opens)::bigint AS true_opens,
       sum(p.by_look)::bigint AS by_look, sum(p.by_pump)::bigint AS by_pump, sum(p.by_reference)::bigint AS by_reference,
       sum(p.by_second_site)::bigint AS by_second_site
FROM points_by_hour p JOIN stations s ON s.id = p.station
GROUP BY s.site, s.line, date_trunc('day', p.hour, 'UTC'), floor(extract(hour FROM p.hour AT TIME ZONE 'UTC') / 8), p.needle;

-- Worst pads of a board design over all stations: no pass at the first touch.
CREATE VIEW worst_pads AS
SELECT board, point, sum(tests)::bigint AS tests, sum(misses)::bigint AS misses, count(DISTINCT station) AS stations,
       count(DISTINCT station) FILTER (WHERE misses > 0) AS stations_missing,
       share_at_least(sum(misses)::bigint, sum(tests)::bigint) AS miss_rate_at_least
FROM points_by_hour GROUP BY board, point;

-- Pads that miss now, at three stations or more: it is the board, or its file. Of the last seven days.
CREATE VIEW bad_pads AS
SELECT board, point, tests, misses, stations_missing, miss_rate_at_least FROM (
    SELECT board, point, sum(tests)::bigint AS tests, sum(misses)::bigint AS misses,
           count(DISTINCT station) FILTER (WHERE misses > 0) AS stations_missing,
           share_at_least(sum(misses)::bigint, sum(tests)::bigint) AS miss_rate_at_least
    FROM points_by_hour WHERE hour > now() - interval '7 days' GROUP BY board, point) AS lately
WHERE stations_missing >= 3 AND miss_rate_at_least > 0.05;

-- How long does a needle last: touches since it was taught, by needle.
CREATE VIEW needle_life AS
SELECT s.site, s.line, s.name AS station, t.needle, t.tip, sum(t.touches)::bigint AS touches,
       min(t.first_touch) AS first_touch, max(t.last_touch) AS last_touch,
       sum(t.passed_value) / nullif(sum(t.passed), 0) AS mean_value
FROM touches_by_hour t JOIN stations s ON s.id = t.station
GROUP BY s.site, s.line, s.name, t.needle, t.tip;

-- Alerts of the stations: raised, worse, acknowledged, cleared.
CREATE VIEW alert_history AS
SELECT r.received_at, s.site, s.line, s.name AS station, r.body ->> 'name' AS alert, r.body ->> 'change' AS change,
       r.outcome AS severity, r.body ->> 'message' AS message
FROM records r JOIN stations s ON s.id = r.station WHERE r.kind = 'alert';

-- Is it the board, the needle, or the station: this point on other stations, other points on this station.
CREATE VIEW who_is_to_blame AS
WITH tested AS (
    SELECT p.station, s.name, p.board, p.point, sum(p.tests)::bigint AS tests, sum(p.misses)::bigint AS misses
    FROM points_by_hour p JOIN stations s ON s.id = p.station GROUP BY p.station, s.name, p.board, p.point
), of_point AS (
    SELECT board, point, sum(tests)::bigint AS tests, sum(misses)::bigint AS misses FROM tested GROUP BY board, point
), of_station AS (
    SELECT station, sum(tests)::bigint AS tests, sum(misses)::bigint AS misses FROM tested GROUP BY station
), compared AS (
    SELECT here.name AS station, here.board, here.point, here.tests, here.misses,
           p.tests - here.tests AS tests_elsewhere, p.misses - here.misses AS misses_elsewhere,
           s.tests - here.tests AS tests_of_other_points, s.misses - here.misses AS misses_of_other_points
    FROM tested here JOIN of_station s ON s.station = here.station
    JOIN of_point p ON p.board IS NOT DISTINCT FROM here.board AND p.point IS NOT DISTINCT FROM here.point
)
SELECT *, CASE WHEN share_at_least(misses, tests) <= 0.05 THEN 'nobody'
               WHEN share_at_least(misses_elsewhere, tests_elsewhere) > 0.05 THEN 'board'
               WHEN share_at_least(misses_of_other_points, tests_of_other_points) > 0.05 THEN 'needle or station'
               ELSE 'this point at this station' END AS suspect
FROM compared;
