-- A journal of version 4, written by the program of that time; put into a file, it is opened by today's.
BEGIN TRANSACTION;
CREATE TABLE alerts (seq INTEGER PRIMARY KEY, at TEXT NOT NULL, body TEXT NOT NULL) STRICT;
CREATE TABLE jobs (
    id TEXT PRIMARY KEY, op TEXT NOT NULL, request TEXT NOT NULL, received_at TEXT NOT NULL,
    seq INTEGER UNIQUE, finished_at TEXT, ok INTEGER, result TEXT
) STRICT;
INSERT INTO "jobs" VALUES('home-f38435da247a','home','{"v":1,"id":"home-f38435da247a","op":"home"}','2026-11-26T04:28:56.152+00:00',12,'2026-11-26T04:29:00.310+00:00',1,'{"id":"home-f38435da247a","op":"home","ok":true,"seq":12,"station":"demo","finished_at":"2026-11-26T04:29:00.310+00:00","outcome":"homed","test_point":null,"error_before_um":null,"error_after_um":null,"looks":0,"moves":1,"timing_ms":{"triggered":{"software":7.57,"total":7.57},"move":{"motion":3707.99,"bus":30.05,"software":0.62,"total":3738.66},"verify":{"bus":53.07,"software":0.99,"total":54.06}},"pictures":null,"detail":{"position":{"x_um":10.3409,"y_um":8.5693,"z_um":29993.3008,"theta_deg":-0.0199}},"error":null}');
INSERT INTO "jobs" VALUES('align-444d3268c5b9','align','{"v":1,"id":"align-444d3268c5b9","op":"align","fiducials":null,"thetas_deg":[0.0,180.0],"board_id":"SN-0042"}','2026-11-26T04:29:38.044+00:00',196,'2026-11-26T04:30:11.710+00:00',1,'{"id":"align-444d3268c5b9","op":"align","ok":true,"seq":196,"station":"demo","finished_at":"2026-11-26T04:30:11.710+00:00","outcome":"aligned","test_point":null,"error_before_um":null,"error_after_um":null,"looks":8,"moves":8,"timing_ms":{"triggered":{"bus":16.68,"software":9790.95,"total":9807.63},"look":{"software":0.42,"total":0.42},"move":{"bus":76.75,"motion":6442.82,"software":3.56,"total":6523.13},"verify":{"bus":262.52,"light":698.23,"exposure":2335.15,"software":13767.97,"total":17063.87}},"pictures":"/var/lib/reprobe/station/pictures/align-444d3268c5b9","detail":{"seat":{"verified":true,"places":4,"agreement":0.976},"board":"demo_board","side":"top","fiducials":4,"shift_um":[49.6,46.7],"turn_deg":-0.0636,"scale_ppm":191,"rms_um":4.2,"record":"/var/lib/reprobe/station/calibration/alignment.json","report":"/var/lib/reprobe/station/calibration/reports/alignment-20261126T043002740.html","seconds":14.62,"in_force":"new","made_at":"2026-11-26T04:30:02.740+00:00"},"error":null}');
INSERT INTO "jobs" VALUES('run-one','run','{"v":1,"id":"run-one","op":"run","plan":"six","version":null,"points":null,"board_id":"SN-0042","order":"short","resume":false,"abandon":false,"stop":{"contact_not_made":5,"failed":null}}','2026-11-26T04:30:38.031+00:00',369,'2026-11-26T04:30:52.996+00:00',1,'{"id":"run-one","op":"run","ok":true,"seq":369,"station":"demo","finished_at":"2026-11-26T04:30:52.996+00:00","outcome":"run_done","test_point":null,"error_before_um":null,"error_after_um":null,"looks":8,"moves":24,"timing_ms":{"triggered":{"bus":17.06,"software":6.34,"total":23.4},"look":{"bus":0.15,"software":0.52,"total":0.67},"move":{"motion":8276.18,"bus":273.51,"software":5.22,"total":8554.91},"verify":{"bus":517.05,"light":858.43,"exposure":3334.8,"software":1674.65,"total":6384.93}},"pictures":"/var/lib/reprobe/station/pictures/run-one","detail":{"run":"run-one","board_id":"SN-0042","plan":"six","plan_hash":"1c7db78167a2be27","state":"done","summary":{"points":6,"done":6,"first_touch_yield":1.0,"passed_first":6,"false_opens":0,"recovered_by":{},"causes":{},"opens_confirmed":0,"failed":0,"contact_not_made":0,"not_tested":0,"touches":6,"touches_mean":1.0,"touches_p99":1,"touches_max":1,"looks":6,"seconds":9.695,"seconds_per_point":1.616,"reference_first_ohm":0.1879,"reference_last_ohm":0.1845}},"error":null}');
CREATE TABLE kept (key TEXT PRIMARY KEY, body TEXT NOT NULL) STRICT;
CREATE TABLE measurements (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, touches INTEGER NOT NULL, job TEXT NOT NULL,
    body TEXT NOT NULL
) STRICT;
CREATE TABLE meta (key TEXT PRIMARY KEY, value INTEGER NOT NULL) STRICT;
INSERT INTO "meta" VALUES('open',1);
INSERT INTO "meta" VALUES('next_seq',10001);
CREATE TABLE orders (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, client TEXT NOT NULL, role TEXT NOT NULL, by TEXT,
    op TEXT NOT NULL, fields TEXT NOT NULL, outcome TEXT
) STRICT;
INSERT INTO "orders" VALUES(1,'2026-11-26T04:28:56.129+00:00','006b8b4568','maintain',NULL,'home','{"id":"home-f38435da247a"}','homed');
INSERT INTO "orders" VALUES(2,'2026-11-26T04:29:00.322+00:00','006b8b4568','maintain',NULL,'place','{"id":"place-f7246e233320","board_um":[-9000.0,15000.0],"theta_deg":0.0}','placed');
INSERT INTO "orders" VALUES(3,'2026-11-26T04:29:01.516+00:00','006b8b4568','maintain',NULL,'calibrate','{"id":"calibrate-667071e098a3","what":"tip","tip_px":[427.44548104956857,619.2298433229797]}','calibrated');
INSERT INTO "orders" VALUES(4,'2026-11-26T04:29:02.348+00:00','006b8b4568','maintain',NULL,'calibrate','{"id":"calibrate-cfeba9959126","what":"map","test_point":"TP5"}','calibrated');
CREATE TABLE points (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, job TEXT NOT NULL, run TEXT, board_id TEXT,
    point TEXT NOT NULL, verdict TEXT NOT NULL, record TEXT NOT NULL
) STRICT;
INSERT INTO "points" VALUES(1,'2026-11-26T04:30:42.136+00:00','run-one','run-one','SN-0042','TP5','pass_first','{"point":"TP5","net":"DATA2","board_id":"SN-0042","method":"continuity","limits":{"low":null,"high":5.0,"unit":"ohm"},"verdict":"pass_first","run":"run-one","reason":"","recovered_by":null,"cause":null,"readings":[{"rung":"touch","site_um":[0.0,0.0],"pressed_um":300.0,"force_n":0.48,"proof":null,"contact_ohm":null,"seen":false,"said":null,"value":0.0,"overload":false,"unit":"ohm"}],"touches":1,"presses":1,"looks":1,"error_um":null,"sigma_um":null,"seconds":1.865,"at":"2026-11-26T04:30:42.136+00:00","pictures":"/var/lib/reprobe/station/pictures/run-one.TP5"}');
INSERT INTO "points" VALUES(2,'2026-11-26T04:30:43.890+00:00','run-one','run-one','SN-0042','TP1','pass_first','{"point":"TP1","net":"CLK","board_id":"SN-0042","method":"continuity","limits":{"low":null,"high":5.0,"unit":"ohm"},"verdict":"pass_first","run":"run-one","reason":"","recovered_by":null,"cause":null,"readings":[{"rung":"touch","site_um":[0.0,0.0],"pressed_um":300.0,"force_n":0.48,"proof":null,"contact_ohm":null,"seen":false,"said":null,"value":0.0067,"overload":false,"unit":"ohm"}],"touches":1,"presses":1,"looks":1,"error_um":null,"sigma_um":null,"seconds":1.459,"at":"2026-11-26T04:30:43.890+00:00","pictures":"/var/lib/reprobe/station/pictures/run-one.TP1"}');
INSERT INTO "points" VALUES(3,'2026-11-26T04:30:45.439+00:00','run-one','run-one','SN-0042','TP3','pass_first','{"point":"TP3","net":"DATA0","board_id":"SN-0042","method":"continuity","limits":{"low":null,"high":5.0,"unit":"ohm"},"verdict":"pass_first","run":"run-one","reason":"","recovered_by":null,"cause":null,"readings":[{"rung":"touch","site_um":[0.0,0.0],"pressed_um":300.0,"force_n":0.48,"proof":null,"contact_ohm":null,"seen":false,"said":null,"value":0.0,"overload":false,"unit":"ohm"}],"touches":1,"presses":1,"looks":1,"error_um":null,"sigma_um":null,"seconds":1.491,"at":"2026-11-26T04:30:45.439+00:00","pictures":"/var/lib/reprobe/station/pictures/run-one.TP3"}');
CREATE TABLE reports (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, job TEXT, retest TEXT, touches INTEGER NOT NULL
) STRICT;
INSERT INTO "reports" VALUES(1,'2026-11-26T04:30:17.876+00:00','calibrate-820e3bbb890b',NULL,1);
INSERT INTO "reports" VALUES(2,'2026-11-26T04:30:20.752+00:00','calibrate-820e3bbb890b',NULL,1);
INSERT INTO "reports" VALUES(3,'2026-11-26T04:30:25.512+00:00','calibrate-820e3bbb890b',NULL,1);
INSERT INTO "reports" VALUES(4,'2026-11-26T04:30:29.341+00:00','calibrate-820e3bbb890b',NULL,1);
INSERT INTO "reports" VALUES(5,'2026-11-26T04:30:39.856+00:00','run-one',NULL,1);
INSERT INTO "reports" VALUES(6,'2026-11-26T04:30:41.703+00:00','run-one',NULL,1);
INSERT INTO "reports" VALUES(7,'2026-11-26T04:30:43.528+00:00','run-one',NULL,1);
INSERT INTO "reports" VALUES(8,'2026-11-26T04:30:44.993+00:00','run-one',NULL,1);
INSERT INTO "reports" VALUES(9,'2026-11-26T04:30:46.793+00:00','run-one',NULL,1);
INSERT INTO "reports" VALUES(10,'2026-11-26T04:30:48.318+00:00','run-one',NULL,1);
INSERT INTO "reports" VALUES(11,'2026-11-26T04:30:50.119+00:00','run-one',NULL,1);
INSERT INTO "reports" VALUES(12,'2026-11-26T04:30:52.408+00:00','run-one',NULL,1);
CREATE TABLE runs (
    n INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, board_id TEXT NOT NULL, plan TEXT NOT NULL,
    plan_hash TEXT NOT NULL, state TEXT NOT NULL CHECK (state IN ('unfinished', 'done', 'abandoned')),
    begun_at TEXT NOT NULL, ended_at TEXT, body TEXT NOT NULL, jobs TEXT NOT NULL, stopped_by TEXT NOT NULL,
    summary TEXT
) STRICT;
INSERT INTO "runs" VALUES(1,'run-one','SN-0042','six','1c7db78167a2be27','done','2026-11-26T04:30:38.054+00:00','2026-11-26T04:30:52.980+00:00','{"id":"run-one","board_id":"SN-0042","plan":{"name":"six","board":"demo_board","board_revision":"c59c37b3e8b65bed","tests":[{"point":"TP1","net":"CLK","method":"continuity","limits":{"low":null,"high":5.0,"unit":"ohm"},"theta_deg":null,"look":"on_open","touches":null,"second_site":true,"note":""},{"point":"TP3","net":"DATA0","method":"continuity","limits":{"low":null,"high":5.0,"unit":"ohm"},"theta_deg":null,"look":"on_open","touches":null,"second_site":true,"note":""},{"point":"TP4","net":"DATA1","method":"continuity","limits":{"low":null,"high":5.0,"unit":"ohm"},"theta_deg":null,"look":"on_open","touches":null,"second_site":true,"note":""},{"point":"TP5","net":"DATA2","method":"continuity","limits":{"low":null,"high":5.0,"unit":"ohm"},"theta_deg":null,"look":"on_open","touches":null,"second_site":true,"note":""},{"point":"TP8","net":"DATA3","method":"continuity","limits":{"low":null,"high":5.0,"unit":"ohm"},"theta_deg":null,"look":"on_open","touches":null,"second_site":true,"note":""},{"point":"TP12","net":"ENABLE","method":"continuity","limits":{"low":null,"high":5.0,"unit":"ohm"},"theta_deg":null,"look":"on_open","touches":null,"second_site":true,"note":""}],"learned_from":[],"note":""},"plan_version":1,"plan_hash":"1c7db78167a2be27","board":{"name":"demo_board","side":"top","revision":"c59c37b3e8b65bed","width_um":40000.0,"height_um":30000.0},"order":[3,0,1,4,2,5],"places":[{"x_um":8000.0,"y_um":25000.0,"theta_deg":0.0},{"x_um":18000.0,"y_um":25000.0,"theta_deg":0.0},{"x_um":23500.0,"y_um":25000.0,"theta_deg":0.0},{"x_um":8000.0,"y_um":19000.0,"theta_deg":0.0},{"x_um":18000.0,"y_um":19000.0,"theta_deg":0.0},{"x_um":26000.0,"y_um":5500.0,"theta_deg":0.0}],"station":"demo","software":"0.1.0","calibrated":{"map":"2026-11-26T04:29:32.792+00:00","alignment":"2026-11-26T04:30:02.740+00:00","surface":"2026-11-26T04:30:30.655+00:00"},"begun_at":"2026-11-26T04:30:38.054+00:00"}','["run-one"]','','{"points":6,"done":6,"first_touch_yield":1.0,"passed_first":6,"false_opens":0,"recovered_by":{},"causes":{},"opens_confirmed":0,"failed":0,"contact_not_made":0,"not_tested":0,"touches":6,"touches_mean":1.0,"touches_p99":1,"touches_max":1,"looks":6,"seconds":9.695,"seconds_per_point":1.616,"reference_first_ohm":0.1879,"reference_last_ohm":0.1845}');
CREATE TABLE standing (name TEXT PRIMARY KEY, body TEXT NOT NULL) STRICT;
CREATE TABLE steps (
    n INTEGER PRIMARY KEY AUTOINCREMENT, job TEXT NOT NULL REFERENCES jobs(id), at TEXT NOT NULL,
    kind TEXT NOT NULL CHECK (kind IN ('look', 'move')), body TEXT NOT NULL
) STRICT;
INSERT INTO "steps" VALUES(56,'align-444d3268c5b9','2026-11-26T04:29:48.935+00:00','move','{"x_um": 54522.96, "y_um": 56755.87, "theta_deg": 0.0}');
INSERT INTO "steps" VALUES(57,'align-444d3268c5b9','2026-11-26T04:29:51.000+00:00','look','{"x_um": 54522.96, "y_um": 56755.87, "z_um": 5600.0, "theta_deg": 0.0, "white_sequence": 2431, "red_sequence": 2461, "tip_px": [428.104, 619.788], "tip_sigma_px": 0.123, "needle": {"width_px": 42.191, "marking_px": 44.975, "contrast": 0.7852, "bend_px": 0.177, "sharpness": 0.1923, "score": 0.9927, "support": 0.938}, "board": {"off_um": [84.9, 0.1], "turn_deg": -0.048, "agreement": 0.982, "log_odds": 200.5, "edges_confirmed": 1.0}, "seat_place": "seat 1"}');
INSERT INTO "steps" VALUES(58,'align-444d3268c5b9','2026-11-26T04:29:51.871+00:00','move','{"x_um": 77562.96, "y_um": 47539.87, "theta_deg": 0.0}');
CREATE TABLE touches (
    n INTEGER PRIMARY KEY AUTOINCREMENT, at TEXT NOT NULL, job TEXT NOT NULL, board_id TEXT, point TEXT NOT NULL,
    z_end_um REAL, pressed_um REAL, force_n REAL, speed_um_s REAL, ended_by TEXT, verdict TEXT, value REAL, unit TEXT
, visit TEXT, rung TEXT, presses INTEGER NOT NULL DEFAULT 1, proof INTEGER, reading TEXT) STRICT;
INSERT INTO "touches" VALUES(1,'2026-11-26T04:30:41.466+00:00','run-one','SN-0042','TP5',4653.57,300.0,0.48,2000.0,NULL,NULL,0.0,'ohm','run-one','touch',1,NULL,NULL);
INSERT INTO "touches" VALUES(2,'2026-11-26T04:30:43.295+00:00','run-one','SN-0042','TP1',4651.85,300.0,0.48,2000.0,NULL,NULL,6.69999999999998374633e-03,'ohm','run-one','touch',1,NULL,NULL);
INSERT INTO "touches" VALUES(3,'2026-11-26T04:30:44.763+00:00','run-one','SN-0042','TP3',4649.73,300.0,0.48,2000.0,NULL,NULL,0.0,'ohm','run-one','touch',1,NULL,NULL);
INSERT INTO "touches" VALUES(4,'2026-11-26T04:30:46.547+00:00','run-one','SN-0042','TP8',4651.45,300.0,0.48,2000.0,NULL,NULL,0.0,'ohm','run-one','touch',1,NULL,NULL);
INSERT INTO "touches" VALUES(5,'2026-11-26T04:30:48.059+00:00','run-one','SN-0042','TP4',4648.57,300.0,0.48,2000.0,NULL,NULL,4.49999999999997624122e-03,'ohm','run-one','touch',1,NULL,NULL);
INSERT INTO "touches" VALUES(6,'2026-11-26T04:30:49.835+00:00','run-one','SN-0042','TP12',4653.63,300.0,0.48,2000.0,NULL,NULL,0.0,'ohm','run-one','touch',1,NULL,NULL);
CREATE INDEX steps_of_job ON steps(job);
CREATE INDEX measurements_at ON measurements(at);
CREATE INDEX alerts_at ON alerts(at);
CREATE INDEX touches_of_pad ON touches(point, board_id);
CREATE INDEX points_of_run ON points(run, n);
CREATE INDEX points_of_job ON points(job, n);
CREATE INDEX runs_of_board ON runs(board_id, state);
CREATE INDEX jobs_of_op ON jobs(op, seq);
CREATE INDEX jobs_of_point ON jobs(json_extract(result, '$.test_point'), seq);
CREATE INDEX jobs_of_board ON jobs(json_extract(request, '$.board_id'), seq);
CREATE INDEX jobs_of_outcome ON jobs(json_extract(result, '$.outcome'), seq);
DELETE FROM "sqlite_sequence";
INSERT INTO "sqlite_sequence" VALUES('orders',8);
INSERT INTO "sqlite_sequence" VALUES('steps',124);
INSERT INTO "sqlite_sequence" VALUES('reports',12);
INSERT INTO "sqlite_sequence" VALUES('runs',1);
INSERT INTO "sqlite_sequence" VALUES('touches',6);
INSERT INTO "sqlite_sequence" VALUES('points',6);
COMMIT;
PRAGMA user_version=4;
