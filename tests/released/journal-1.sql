-- A journal of version 1, written by the program of that time; put into a file, it is opened by today's.
BEGIN TRANSACTION;
CREATE TABLE alerts (seq INTEGER PRIMARY KEY, at TEXT NOT NULL, body TEXT NOT NULL) STRICT;
CREATE TABLE jobs (
    id TEXT PRIMARY KEY, op TEXT NOT NULL, request TEXT NOT NULL, received_at TEXT NOT NULL,
    seq INTEGER UNIQUE, finished_at TEXT, ok INTEGER, result TEXT
) STRICT;
INSERT INTO "jobs" VALUES('home-f0c61f1914af','home','{"v":1,"id":"home-f0c61f1914af","op":"home"}','2026-11-26T00:43:08.950+00:00',16,'2026-11-26T00:43:14.174+00:00',1,'{"id":"home-f0c61f1914af","op":"home","ok":true,"seq":16,"station":"demo","finished_at":"2026-11-26T00:43:14.174+00:00","outcome":"homed","test_point":null,"error_before_um":null,"error_after_um":null,"looks":0,"moves":1,"timing_ms":{"triggered":{"software":0.45,"total":0.45},"look":{"software":0.05,"total":0.05},"move":{"motion":5094.89,"software":0.19,"total":5095.08},"verify":{"bus":127.13,"software":0.4,"total":127.53}},"pictures":null,"detail":{"position":{"x_um":10.3409,"y_um":8.5693,"z_um":29993.3008,"theta_deg":-0.0199}},"error":null}');
INSERT INTO "jobs" VALUES('place-a1a391399010','place','{"v":1,"id":"place-a1a391399010","op":"place","test_point":null,"board_um":[-9000.0,15000.0],"theta_deg":0.0}','2026-11-26T00:43:14.176+00:00',24,'2026-11-26T00:43:16.226+00:00',1,'{"id":"place-a1a391399010","op":"place","ok":true,"seq":24,"station":"demo","finished_at":"2026-11-26T00:43:16.226+00:00","outcome":"placed","test_point":null,"error_before_um":null,"error_after_um":null,"looks":0,"moves":1,"timing_ms":{"triggered":{"bus":57.45,"software":0.63,"total":58.08},"look":{"software":0.06,"total":0.06},"move":{"motion":1968.1,"software":0.31,"total":1968.41},"verify":{"bus":22.54,"software":0.45,"total":22.99}},"pictures":null,"detail":{"position":{"x_um":36082.9559,"y_um":55795.8679,"z_um":5200.0,"theta_deg":0.0}},"error":null}');
INSERT INTO "jobs" VALUES('calibrate-1e768deacb7f','calibrate','{"v":1,"id":"calibrate-1e768deacb7f","op":"calibrate","what":"surface","tip_px":null,"test_point":null,"theta_deg":0.0,"angles":null,"every_deg":null,"model":"auto","resume":true,"places":12}','2026-11-26T00:45:42.560+00:00',465,'2026-11-26T00:45:59.477+00:00',0,'{"id":"calibrate-1e768deacb7f","op":"calibrate","ok":false,"seq":465,"station":"demo","finished_at":"2026-11-26T00:45:59.477+00:00","outcome":"failed","test_point":null,"error_before_um":null,"error_after_um":null,"looks":24,"moves":17,"timing_ms":{"triggered":{"bus":58.77,"software":1.02,"total":59.79},"look":{"software":0.09,"total":0.09},"move":{"bus":369.3,"motion":10294.69,"software":5.72,"total":10669.71},"verify":{"bus":520.91,"light":959.87,"exposure":3584.25,"software":813.85,"total":5878.88}},"pictures":"/var/lib/reprobe/station/pictures/calibrate-1e768deacb7f","detail":{},"error":{"code":4101,"name":"link_lost","message":"/run/reprobe-demo/bus 115200 8N1: not connected; next try in 0.1 s ([Errno 2] could not open port /run/reprobe-demo/bus: [Errno 2] No such file or directory: ''/run/reprobe-demo/bus'')","advice":"Plug in the adapter, or correct the port in the configuration.","detail":{"device":"/run/reprobe-demo/bus 115200 8N1"}}}');
CREATE TABLE meta (key TEXT PRIMARY KEY, value INTEGER NOT NULL) STRICT;
INSERT INTO "meta" VALUES('next_seq',1001);
CREATE TABLE reports (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, job TEXT, retest TEXT, touches INTEGER NOT NULL
) STRICT;
CREATE TABLE steps (
    n INTEGER PRIMARY KEY AUTOINCREMENT, job TEXT NOT NULL REFERENCES jobs(id), at TEXT NOT NULL,
    kind TEXT NOT NULL CHECK (kind IN ('look', 'move')), body TEXT NOT NULL
) STRICT;
INSERT INTO "steps" VALUES(1,'place-a1a391399010','2026-11-26T00:43:16.203+00:00','move','{"x_um": 36082.9558, "y_um": 55795.8675, "z_um": 5200.0, "theta_deg": 0.0}');
INSERT INTO "steps" VALUES(156,'calibrate-1e768deacb7f','2026-11-26T00:45:45.271+00:00','move','{"x_um": 53143.45, "y_um": 52804.07, "theta_deg": 0.0}');
INSERT INTO "steps" VALUES(157,'calibrate-1e768deacb7f','2026-11-26T00:45:46.134+00:00','move','{"x_um": 53143.45, "y_um": 52804.07, "theta_deg": 0.0}');
INSERT INTO "steps" VALUES(158,'calibrate-1e768deacb7f','2026-11-26T00:45:46.960+00:00','move','{"x_um": 53143.45, "y_um": 52804.07, "theta_deg": 0.0}');
INSERT INTO "steps" VALUES(159,'calibrate-1e768deacb7f','2026-11-26T00:45:47.725+00:00','move','{"x_um": 53143.45, "y_um": 52804.07, "theta_deg": 0.0}');
INSERT INTO "steps" VALUES(160,'calibrate-1e768deacb7f','2026-11-26T00:45:48.660+00:00','move','{"x_um": 68651.95, "y_um": 59785.81, "theta_deg": 0.0}');
CREATE INDEX steps_of_job ON steps(job);
DELETE FROM "sqlite_sequence";
INSERT INTO "sqlite_sequence" VALUES('steps',171);
COMMIT;
PRAGMA user_version=1;
