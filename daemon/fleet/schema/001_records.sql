-- Records of all stations. A row is one record; (journal, seq) tells it from every other.

CREATE TABLE stations (
    id integer GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    site text NOT NULL, line text NOT NULL, name text NOT NULL,
    first_seen timestamptz NOT NULL DEFAULT now(),
    UNIQUE (site, line, name)
);

-- What one opening of a station's journal wrote, and how far it is stored. The cursor moves with the rows.
CREATE TABLE journals (
    id bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    station integer NOT NULL REFERENCES stations, journal text NOT NULL, stored_seq bigint NOT NULL,
    begun_at timestamptz NOT NULL DEFAULT now(),
    UNIQUE (station, journal)
);

-- What is asked of years. Partitions by month of receipt: a station's clock decides about nothing.
-- `body` only where it says more than the columns: what was not good, alerts, orders, runs, holes.
CREATE TABLE records (
    received_at timestamptz NOT NULL, station integer NOT NULL, journal bigint NOT NULL, seq bigint NOT NULL,
    kind text NOT NULL, at timestamptz, item text, job text, op text,
    board text, board_side text, board_revision text, board_id text, point text,
    outcome text, ok boolean, recovered_by text, cause text,
    error_before_um double precision, error_after_um double precision, theta_deg double precision,
    value double precision, touches bigint,
    needle text, tip text, program text, configuration text, body jsonb,
    PRIMARY KEY (journal, seq, received_at)
) PARTITION BY RANGE (received_at);
CREATE INDEX records_of_board ON records (board_id) WHERE board_id IS NOT NULL;
CREATE INDEX records_of_point ON records (board, point, kind);
CREATE INDEX records_of_station ON records (station, kind, received_at);
COMMENT ON COLUMN records.at IS 'by the station''s clock; order by seq, not by this';
COMMENT ON COLUMN records.item IS 'which thing of its kind it tells of; the record of the highest seq holds';

-- The whole of every record, for some days. Partitions by day of receipt.
CREATE TABLE recent (
    received_at timestamptz NOT NULL, journal bigint NOT NULL, seq bigint NOT NULL,
    body jsonb, circumstances jsonb NOT NULL,
    PRIMARY KEY (journal, seq, received_at)
) PARTITION BY RANGE (received_at);

-- Messages and rows that nobody can read, with the reason; of one kind the first is kept, and counted.
CREATE TABLE refused (
    topic text NOT NULL, journal text NOT NULL, seq bigint NOT NULL, reason text NOT NULL,
    said text NOT NULL, first_at timestamptz NOT NULL DEFAULT now(), last_at timestamptz NOT NULL DEFAULT now(),
    times bigint NOT NULL DEFAULT 1,
    PRIMARY KEY (topic, journal, seq, reason)
);

-- How a station was when it last said so.
CREATE TABLE states (
    station integer PRIMARY KEY REFERENCES stations, at timestamptz NOT NULL, online boolean NOT NULL,
    state text, fault text, program text, alerts text[] NOT NULL DEFAULT '{}', body jsonb NOT NULL
);
