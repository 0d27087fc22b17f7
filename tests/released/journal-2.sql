-- A journal of version 2, written by the program of that time; put into a file, it is opened by today's.
BEGIN TRANSACTION;
CREATE TABLE alerts (seq INTEGER PRIMARY KEY, at TEXT NOT NULL, body TEXT NOT NULL) STRICT;
CREATE TABLE jobs (
    id TEXT PRIMARY KEY, op TEXT NOT NULL, request TEXT NOT NULL, received_at TEXT NOT NULL,
    seq INTEGER UNIQUE, finished_at TEXT, ok INTEGER, result TEXT
) STRICT;
INSERT INTO "jobs" VALUES('home-b78deccb9c1a','home','{"v":1,"id":"home-b78deccb9c1a","op":"home"}','2026-11-26T00:53:05.133+00:00',15,'2026-11-26T00:53:11.570+00:00',1,'{"id":"home-b78deccb9c1a","op":"home","ok":true,"seq":15,"station":"demo","finished_at":"2026-11-26T00:53:11.570+00:00","outcome":"homed","test_point":null,"error_before_um":null,"error_after_um":null,"looks":0,"moves":1,"timing_ms":{"triggered":{"software":0.72,"total":0.72},"move":{"motion":5715.3,"bus":49.98,"software":0.41,"total":5765.69},"verify":{"bus":121.36,"software":0.55,"total":121.91}},"pictures":null,"detail":{"position":{"x_um":10.3409,"y_um":8.5693,"z_um":29993.3008,"theta_deg":-0.0199}},"error":null}');
INSERT INTO "jobs" VALUES('place-1a3f77353fa5','place','{"v":1,"id":"place-1a3f77353fa5","op":"place","test_point":null,"board_um":[-9000.0,15000.0],"theta_deg":0.0,"board_id":null}','2026-11-26T00:53:11.573+00:00',23,'2026-11-26T00:53:13.731+00:00',1,'{"id":"place-1a3f77353fa5","op":"place","ok":true,"seq":23,"station":"demo","finished_at":"2026-11-26T00:53:13.731+00:00","outcome":"placed","test_point":null,"error_before_um":null,"error_after_um":null,"looks":0,"moves":1,"timing_ms":{"triggered":{"bus":45.76,"software":0.95,"total":46.71},"look":{"software":0.09,"total":0.09},"move":{"motion":2089.39,"software":0.41,"total":2089.8},"verify":{"bus":19.53,"software":0.75,"total":20.28}},"pictures":null,"detail":{"position":{"x_um":36082.9559,"y_um":55795.8679,"z_um":5600.0,"theta_deg":0.0},"confirmed_by":"drives","height":"unknown","height_within_um":500.0},"error":null}');
INSERT INTO "jobs" VALUES('calibrate-51402c633f9f','calibrate','{"v":1,"id":"calibrate-51402c633f9f","op":"calibrate","what":"rotation","tip_px":null,"test_point":null,"theta_deg":0.0,"angles":24,"every_deg":null,"model":"auto","resume":true,"places":12}','2026-11-26T00:53:49.308+00:00',NULL,NULL,NULL,NULL);
CREATE TABLE kept (key TEXT PRIMARY KEY, body TEXT NOT NULL) STRICT;
CREATE TABLE measurements (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, touches INTEGER NOT NULL, job TEXT NOT NULL,
    body TEXT NOT NULL
) STRICT;
CREATE TABLE meta (key TEXT PRIMARY KEY, value INTEGER NOT NULL) STRICT;
INSERT INTO "meta" VALUES('open',1);
INSERT INTO "meta" VALUES('next_seq',10001);
CREATE TABLE reports (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, job TEXT, retest TEXT, touches INTEGER NOT NULL
) STRICT;
INSERT INTO "reports" VALUES(1,'2026-11-26T00:54:01.094+00:00','calibrate-51402c633f9f',NULL,1);
INSERT INTO "reports" VALUES(2,'2026-11-26T00:54:06.450+00:00','calibrate-51402c633f9f',NULL,1);
INSERT INTO "reports" VALUES(3,'2026-11-26T00:54:12.053+00:00','calibrate-51402c633f9f',NULL,1);
CREATE TABLE standing (name TEXT PRIMARY KEY, body TEXT NOT NULL) STRICT;
CREATE TABLE steps (
    n INTEGER PRIMARY KEY AUTOINCREMENT, job TEXT NOT NULL REFERENCES jobs(id), at TEXT NOT NULL,
    kind TEXT NOT NULL CHECK (kind IN ('look', 'move')), body TEXT NOT NULL
) STRICT;
INSERT INTO "steps" VALUES(1,'place-1a3f77353fa5','2026-11-26T00:53:13.711+00:00','move','{"x_um": 36082.9558, "y_um": 55795.8675, "z_um": 5600.0, "theta_deg": 0.0}');
INSERT INTO "steps" VALUES(54,'calibrate-51402c633f9f','2026-11-26T00:53:52.085+00:00','move','{"x_um": 41006.33, "y_um": 11899.88, "theta_deg": 140.5125}');
INSERT INTO "steps" VALUES(55,'calibrate-51402c633f9f','2026-11-26T00:53:52.390+00:00','look','{"x_um": 41006.33, "y_um": 11899.88, "z_um": 5600.0, "theta_deg": -219.4875, "white_sequence": 737, "tip_px": [426.875, 619.13], "tip_sigma_px": 0.125, "needle": {"width_px": 42.73, "marking_px": 44.931, "contrast": 0.7773, "bend_px": -0.059, "sharpness": 0.2009, "score": 0.9912, "support": 0.955}}');
INSERT INTO "steps" VALUES(56,'calibrate-51402c633f9f','2026-11-26T00:53:53.520+00:00','move','{"x_um": 41009.37, "y_um": 12013.21, "theta_deg": 140.5125}');
INSERT INTO "steps" VALUES(57,'calibrate-51402c633f9f','2026-11-26T00:53:53.872+00:00','look','{"x_um": 41009.38, "y_um": 12013.21, "z_um": 5600.0, "theta_deg": -219.4875, "white_sequence": 759, "tip_px": [429.616, 621.272], "tip_sigma_px": 0.123, "needle": {"width_px": 42.774, "marking_px": 45.001, "contrast": 0.7799, "bend_px": -0.014, "sharpness": 0.197, "score": 0.9636, "support": 0.964}}');
INSERT INTO "steps" VALUES(58,'calibrate-51402c633f9f','2026-11-26T00:53:54.965+00:00','move','{"x_um": 43227.24, "y_um": 12019.93, "theta_deg": 140.5125}');
CREATE INDEX steps_of_job ON steps(job);
CREATE INDEX measurements_at ON measurements(at);
CREATE INDEX alerts_at ON alerts(at);
DELETE FROM "sqlite_sequence";
INSERT INTO "sqlite_sequence" VALUES('steps',156);
INSERT INTO "sqlite_sequence" VALUES('reports',3);
COMMIT;
PRAGMA user_version=2;
