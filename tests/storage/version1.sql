-- A database of schema version 1, as its server left it: a finished, a failed and a paused job.
PRAGMA application_id = 1330790996;
PRAGMA user_version = 1;
PRAGMA foreign_keys = OFF;
BEGIN TRANSACTION;
CREATE TABLE deleted_jobs (
  job INTEGER PRIMARY KEY
) STRICT;
CREATE TABLE iterations (
  job               INTEGER NOT NULL,  -- jobs.key, or deleted_jobs.job
  iteration         INTEGER NOT NULL,  -- dense from 1
  k1 ANY, k2 ANY, k3 ANY, k4 ANY, k5 ANY,
  cost              ANY,               -- NULL: NaN, here and in every double
  settling_samples  INTEGER NOT NULL,
  fuel_sum          ANY,
  outcome           INTEGER NOT NULL,  -- 0 settled, 1 not settled, 2 left the domain, 3 numerical failure
  cost_std          ANY,
  pairs_left_out    INTEGER NOT NULL,
  pairs_not_settled INTEGER NOT NULL,
  PRIMARY KEY (job, iteration)
) STRICT, WITHOUT ROWID;
INSERT INTO "iterations" VALUES(1,1,0.1,1.0,1.0,1.0,10.0,8.12627835817227378318e+02,343,9.3925567163445471408e+00,0,2.99554759609577958556e+00,0,0);
INSERT INTO "iterations" VALUES(1,2,0.103141595253425,1.00124805276814732302e+00,1.0018294147432322827e+00,9.99613921574472930053e-01,9.98807242925292193547e+00,7.98881823018501563632e+02,333,9.31763646037003,0,2.33867098894701896938e+00,0,0);
INSERT INTO "iterations" VALUES(1,3,1.05848396798126742623e-01,1.01332667447161450802e+00,1.00895765522938574143e+00,1.0014165022589029963e+00,9.94745263124495870954e+00,7.87683442954705128604e+02,326,9.23366885909410228805e+00,0,0.796017734694098,0,0);
INSERT INTO "iterations" VALUES(1,4,1.06429363427253148577e-01,1.01764256063006430785e+00,1.00890711672285071642e+00,1.01131175305324938484e+00,9.94625872232378327453e+00,7.84173580598715716386e+02,323,9.22347161197431297807e+00,0,4.17577905526525,0,0);
INSERT INTO "iterations" VALUES(1,5,1.10723359569370113919e-01,1.0079929676847574349e+00,9.99040065069718097312e-01,1.01425173068557650246e+00,9.94323009616832109713e+00,7.6519535062007616945e+02,308,9.14390701240152381501e+00,0,1.78781443342357015957e+00,0,0);
INSERT INTO "iterations" VALUES(1,6,1.12884223787522081083e-01,1.0055260622962591821e+00,1.00087128275958137102e+00,1.02820488788232333732e+00,9.94408767199882426268e+00,7.57329366943492232177e+02,302,9.10658733886984528282e+00,0,3.79047378099632448211e+00,0,0);
INSERT INTO "iterations" VALUES(3,1,0.1,1.0,1.0,1.0,10.0,2.61772959564193115518e+02,235,6.69323989104827349327e-02,0,4.29318815959403965454e-01,0,0);
INSERT INTO "iterations" VALUES(3,2,1.00321324985209431313e-01,9.91273269236026766115e-01,1.00502999238240708912e+00,1.00096775658909753481e+00,9.87707389985497385964e+00,2.59474170151801615709e+02,233,6.61854253795039898511e-02,0,4.54035863314895191122e-02,0,0);
INSERT INTO "iterations" VALUES(3,3,1.00048562569227728058e-01,9.93676062798709569534e-01,1.00597264906007377582e+00,1.00110634776010742896e+00,9.77129605088676633783e+00,2.51107065008148566676e+02,225,6.526766252037141669e-02,0,2.3266283341840887644e+00,0,0);
INSERT INTO "iterations" VALUES(3,4,1.00859584981938518732e-01,9.95070673412357664666e-01,1.00123639931176189321e+00,1.00333571572293700491e+00,9.72690832189373821847e+00,2.48975187172653846792e+02,223,6.49379679316346436479e-02,0,5.1210579785412535525e-01,0,0);
CREATE TABLE job_documents (
  job    INTEGER PRIMARY KEY REFERENCES jobs (key) ON DELETE CASCADE,
  spec   TEXT NOT NULL,  -- JSON: the exact inputs
  report TEXT            -- JSON, where the job succeeded
) STRICT;
INSERT INTO "job_documents" VALUES(1,'{"display_name":"finished","labels":{"team":"orbit"},"scenario":{"id":"gto-geo","display_name":"GTO to GEO transfer","description":"The paper''s scenario A: from an inclined geostationary transfer orbit to a circular equatorial GEO. The longitude of periapsis is -127 deg, the mirror image of the printed one.","gravitational_parameter_km3_s2":398600.4418,"target":{"equinoctial":{"p_km":42165.0,"ex":0.0,"ey":0.0,"hx":0.0,"hy":0.0,"true_longitude_deg":0.0}},"chaser":{"keplerian":{"semi_major_axis_km":24364.0,"eccentricity":0.7306,"inclination_deg":63.0,"raan_deg":75.0,"argument_of_periapsis_deg":158.0,"position":"TRUE_LONGITUDE","position_deg":30.0}},"sampling_period_s":2700.0,"horizon_samples":1280,"fuel_weight":50.0,"settling_distance_km":10.0,"velocity_unit_m_s":0.0,"acceleration_unit_m_s2":0.6725968377437437,"control_hold":"CONTINUOUS","integration_tolerance":1e-09,"search":{"iterations":6,"step_size":0.005,"exploration_scale":0.002,"directions":2,"initial_gains":[0.1,1.0,1.0,1.0,10.0],"exploration_std":[0.31622776601683794,1.0,1.0,1.0,3.1622776601683795],"gain_floor":0.001,"seed":3}},"initial_condition":{"keplerian":{"semi_major_axis_km":24364.0,"eccentricity":0.7306,"inclination_deg":63.0,"raan_deg":75.0,"argument_of_periapsis_deg":158.0,"position":"TRUE_LONGITUDE","position_deg":30.0}}}','{"initial":{"iteration":1,"gains":[0.1,1.0,1.0,1.0,10.0],"episode":{"outcome":"SETTLED","outcome_message":"","end_time_s":3456000.0000000005,"cost":812.6278358172274,"settling_samples":343,"settling_time_s":926100.0,"fuel_sum":9.392556716344547,"delta_v_to_settling_m_s":10603.559581953668,"delta_v_horizon_m_s":10604.123795794681,"peak_acceleration_m_s2":2.9991808391493118,"initial_lyapunov":0.3407633130473573,"domain_guaranteed":true}},"final":{"iteration":6,"gains":[0.11288422378752208,1.0055260622962592,1.0008712827595814,1.0282048878823233,9.944087671998824],"episode":{"outcome":"SETTLED","outcome_message":"","end_time_s":3456000.0000000005,"cost":757.3293669434922,"settling_samples":302,"settling_time_s":815400.0,"fuel_sum":9.106587338869845,"delta_v_to_settling_m_s":10192.725947923735,"delta_v_horizon_m_s":10193.726578737527,"peak_acceleration_m_s2":2.949840000557771,"initial_lyapunov":0.34216525669583053,"domain_guaranteed":true}},"best":{"iteration":6,"gains":[0.11288422378752208,1.0055260622962592,1.0008712827595814,1.0282048878823233,9.944087671998824],"episode":{"outcome":"SETTLED","outcome_message":"","end_time_s":3456000.0000000005,"cost":757.3293669434922,"settling_samples":302,"settling_time_s":815400.0,"fuel_sum":9.106587338869845,"delta_v_to_settling_m_s":10192.725947923735,"delta_v_horizon_m_s":10193.726578737527,"peak_acceleration_m_s2":2.949840000557771,"initial_lyapunov":0.34216525669583053,"domain_guaranteed":true}},"warnings":[{"kind":"PEAK_ACCELERATION","message":"K of iteration 6 asks for 2.95 m/s^2 at its peak: beyond a chemical engine''s (about 1 m/s^2)"}],"episodes":30}');
INSERT INTO "job_documents" VALUES(2,'{"display_name":"","labels":{},"scenario":{"id":"gto-geo-printed","display_name":"GTO to GEO transfer, as printed","description":"Scenario A with the longitude of periapsis as the paper prints it (+127 deg): the closed loop reaches zero angular momentum and leaves the domain, so that a tuning job on it fails. Kept to show exactly that.","gravitational_parameter_km3_s2":398600.4418,"target":{"equinoctial":{"p_km":42165.0,"ex":0.0,"ey":0.0,"hx":0.0,"hy":0.0,"true_longitude_deg":0.0}},"chaser":{"keplerian":{"semi_major_axis_km":24364.0,"eccentricity":0.7306,"inclination_deg":63.0,"raan_deg":75.0,"argument_of_periapsis_deg":52.0,"position":"TRUE_LONGITUDE","position_deg":30.0}},"sampling_period_s":2700.0,"horizon_samples":1280,"fuel_weight":50.0,"settling_distance_km":10.0,"velocity_unit_m_s":0.0,"acceleration_unit_m_s2":0.6725968377437437,"control_hold":"CONTINUOUS","integration_tolerance":1e-09,"search":{"iterations":5,"step_size":0.005,"exploration_scale":0.002,"directions":2,"initial_gains":[0.1,1.0,1.0,1.0,10.0],"exploration_std":[0.31622776601683794,1.0,1.0,1.0,3.1622776601683795],"gain_floor":0.001,"seed":1}},"initial_condition":{"keplerian":{"semi_major_axis_km":24364.0,"eccentricity":0.7306,"inclination_deg":63.0,"raan_deg":75.0,"argument_of_periapsis_deg":52.0,"position":"TRUE_LONGITUDE","position_deg":30.0}}}',NULL);
INSERT INTO "job_documents" VALUES(3,'{"display_name":"paused","labels":{},"scenario":{"id":"leo-rendezvous","display_name":"LEO rendezvous","description":"The paper''s scenario B: terminal rendezvous with a target on a circular orbit of 1000 km altitude, from a neighbourhood of some 60 km.","gravitational_parameter_km3_s2":398600.4418,"target":{"equinoctial":{"p_km":7378.137,"ex":0.0,"ey":0.0,"hx":0.8540806854634666,"hy":0.0,"true_longitude_deg":45.0}},"chaser":{"equinoctial":{"p_km":7393.137,"ex":3e-05,"ey":-2e-05,"hx":0.8555806854634666,"hy":-0.001,"true_longitude_deg":45.4}},"sampling_period_s":180.0,"horizon_samples":1280,"fuel_weight":400.0,"settling_distance_km":1.0,"velocity_unit_m_s":0.0,"acceleration_unit_m_s2":21.966739520234142,"control_hold":"CONTINUOUS","integration_tolerance":1e-09,"search":{"iterations":5000,"step_size":0.005,"exploration_scale":0.002,"directions":3,"initial_gains":[0.1,1.0,1.0,1.0,10.0],"exploration_std":[0.1,1.0,1.0,1.0,10.0],"gain_floor":0.001,"seed":9}},"initial_condition":{"keplerian":{"semi_major_axis_km":7390.0,"eccentricity":0.001,"inclination_deg":81.1,"raan_deg":0.2,"argument_of_periapsis_deg":10.0,"position":"TRUE_LONGITUDE","position_deg":45.3}}}',NULL);
CREATE TABLE job_events (
  job     INTEGER NOT NULL REFERENCES jobs (key) ON DELETE CASCADE,
  seq     INTEGER NOT NULL,
  state   TEXT NOT NULL,
  time_us INTEGER NOT NULL,
  message TEXT NOT NULL,
  PRIMARY KEY (job, seq)
) STRICT, WITHOUT ROWID;
INSERT INTO "job_events" VALUES(1,1,'QUEUED',1795334862166446,'');
INSERT INTO "job_events" VALUES(1,2,'RUNNING',1795334862167766,'');
INSERT INTO "job_events" VALUES(1,9,'SUCCEEDED',1795334862192527,'');
INSERT INTO "job_events" VALUES(2,1,'QUEUED',1795334862211476,'');
INSERT INTO "job_events" VALUES(2,2,'RUNNING',1795334862212415,'');
INSERT INTO "job_events" VALUES(2,3,'FAILED',1795334862212787,'iteration 1: all 2 pairs of episodes left the domain or failed, so there is no cost to improve. Under K(1): left the domain of the error coordinates at t = 548.773 s: the angular momentum reached zero (angular momentum at 9.87e-05 of the target''s, radius at 14320.8 km)');
INSERT INTO "job_events" VALUES(3,1,'QUEUED',1795334862248165,'');
INSERT INTO "job_events" VALUES(3,2,'RUNNING',1795334862250438,'');
INSERT INTO "job_events" VALUES(3,7,'PAUSED',1795334862596441,'');
CREATE TABLE job_labels (
  job       INTEGER NOT NULL REFERENCES jobs (key) ON DELETE CASCADE,
  label_key TEXT NOT NULL,
  value     TEXT NOT NULL,
  PRIMARY KEY (job, label_key)
) STRICT, WITHOUT ROWID;
INSERT INTO "job_labels" VALUES(1,'team','orbit');
CREATE TABLE jobs (
  key            INTEGER PRIMARY KEY AUTOINCREMENT,
  id             TEXT NOT NULL UNIQUE,
  state          TEXT NOT NULL,
  scenario_id    TEXT NOT NULL,
  create_time_us INTEGER NOT NULL,  -- microseconds since 1970, UTC
  start_time_us  INTEGER,
  end_time_us    INTEGER,
  update_time_us INTEGER NOT NULL,
  last_seq       INTEGER NOT NULL,
  state_changes  INTEGER NOT NULL,
  iterations     INTEGER NOT NULL,  -- completed
  best_iteration INTEGER,
  best_cost      REAL,
  request_id     TEXT UNIQUE,
  request_digest TEXT,
  error_message  TEXT NOT NULL
) STRICT;
INSERT INTO "jobs" VALUES(1,'finished','SUCCEEDED','gto-geo',1795334862166446,1795334862167766,1795334862192527,1795334862192527,9,3,6,6,7.57329366943492232177e+02,'11111111-0000-4000-8000-000000000001','{"display_name":"finished","labels":{"team":"orbit"},"scenario":{"id":"gto-geo","display_name":"GTO to GEO transfer","description":"The paper''s scenario A: from an inclined geostationary transfer orbit to a circular equatorial GEO. The longitude of periapsis is -127 deg, the mirror image of the printed one.","gravitational_parameter_km3_s2":398600.4418,"target":{"equinoctial":{"p_km":42165.0,"ex":0.0,"ey":0.0,"hx":0.0,"hy":0.0,"true_longitude_deg":0.0}},"chaser":{"keplerian":{"semi_major_axis_km":24364.0,"eccentricity":0.7306,"inclination_deg":63.0,"raan_deg":75.0,"argument_of_periapsis_deg":158.0,"position":"TRUE_LONGITUDE","position_deg":30.0}},"sampling_period_s":2700.0,"horizon_samples":1280,"fuel_weight":50.0,"settling_distance_km":10.0,"velocity_unit_m_s":0.0,"acceleration_unit_m_s2":0.6725968377437437,"control_hold":"CONTINUOUS","integration_tolerance":1e-09,"search":{"iterations":6,"step_size":0.005,"exploration_scale":0.002,"directions":2,"initial_gains":[0.1,1.0,1.0,1.0,10.0],"exploration_std":[0.31622776601683794,1.0,1.0,1.0,3.1622776601683795],"gain_floor":0.001,"seed":3}},"initial_condition":{"keplerian":{"semi_major_axis_km":24364.0,"eccentricity":0.7306,"inclination_deg":63.0,"raan_deg":75.0,"argument_of_periapsis_deg":158.0,"position":"TRUE_LONGITUDE","position_deg":30.0}}}','');
INSERT INTO "jobs" VALUES(2,'failed','FAILED','gto-geo-printed',1795334862211476,1795334862212415,1795334862212787,1795334862212787,3,3,0,NULL,NULL,'b6c1aafb-f8a3-4b80-9678-5aa5b4c2501e','{"display_name":"","labels":{},"scenario":{"id":"gto-geo-printed","display_name":"GTO to GEO transfer, as printed","description":"Scenario A with the longitude of periapsis as the paper prints it (+127 deg): the closed loop reaches zero angular momentum and leaves the domain, so that a tuning job on it fails. Kept to show exactly that.","gravitational_parameter_km3_s2":398600.4418,"target":{"equinoctial":{"p_km":42165.0,"ex":0.0,"ey":0.0,"hx":0.0,"hy":0.0,"true_longitude_deg":0.0}},"chaser":{"keplerian":{"semi_major_axis_km":24364.0,"eccentricity":0.7306,"inclination_deg":63.0,"raan_deg":75.0,"argument_of_periapsis_deg":52.0,"position":"TRUE_LONGITUDE","position_deg":30.0}},"sampling_period_s":2700.0,"horizon_samples":1280,"fuel_weight":50.0,"settling_distance_km":10.0,"velocity_unit_m_s":0.0,"acceleration_unit_m_s2":0.6725968377437437,"control_hold":"CONTINUOUS","integration_tolerance":1e-09,"search":{"iterations":5,"step_size":0.005,"exploration_scale":0.002,"directions":2,"initial_gains":[0.1,1.0,1.0,1.0,10.0],"exploration_std":[0.31622776601683794,1.0,1.0,1.0,3.1622776601683795],"gain_floor":0.001,"seed":1}},"initial_condition":{"keplerian":{"semi_major_axis_km":24364.0,"eccentricity":0.7306,"inclination_deg":63.0,"raan_deg":75.0,"argument_of_periapsis_deg":52.0,"position":"TRUE_LONGITUDE","position_deg":30.0}}}','iteration 1: all 2 pairs of episodes left the domain or failed, so there is no cost to improve. Under K(1): left the domain of the error coordinates at t = 548.773 s: the angular momentum reached zero (angular momentum at 9.87e-05 of the target''s, radius at 14320.8 km)');
INSERT INTO "jobs" VALUES(3,'paused','PAUSED','leo-rendezvous',1795334862248165,1795334862250438,NULL,1795334862596441,7,3,4,4,2.48975187172653846792e+02,'11111111-0000-4000-8000-000000000002','{"display_name":"paused","labels":{},"scenario":{"id":"leo-rendezvous","display_name":"LEO rendezvous","description":"The paper''s scenario B: terminal rendezvous with a target on a circular orbit of 1000 km altitude, from a neighbourhood of some 60 km.","gravitational_parameter_km3_s2":398600.4418,"target":{"equinoctial":{"p_km":7378.137,"ex":0.0,"ey":0.0,"hx":0.8540806854634666,"hy":0.0,"true_longitude_deg":45.0}},"chaser":{"equinoctial":{"p_km":7393.137,"ex":3e-05,"ey":-2e-05,"hx":0.8555806854634666,"hy":-0.001,"true_longitude_deg":45.4}},"sampling_period_s":180.0,"horizon_samples":1280,"fuel_weight":400.0,"settling_distance_km":1.0,"velocity_unit_m_s":0.0,"acceleration_unit_m_s2":21.966739520234142,"control_hold":"CONTINUOUS","integration_tolerance":1e-09,"search":{"iterations":5000,"step_size":0.005,"exploration_scale":0.002,"directions":3,"initial_gains":[0.1,1.0,1.0,1.0,10.0],"exploration_std":[0.1,1.0,1.0,1.0,10.0],"gain_floor":0.001,"seed":9}},"initial_condition":{"keplerian":{"semi_major_axis_km":7390.0,"eccentricity":0.001,"inclination_deg":81.1,"raan_deg":0.2,"argument_of_periapsis_deg":10.0,"position":"TRUE_LONGITUDE","position_deg":45.3}}}','');
CREATE INDEX jobs_by_create_time ON jobs (create_time_us, id);
CREATE INDEX jobs_by_best_cost ON jobs (best_cost, id);
CREATE INDEX jobs_by_state ON jobs (state, create_time_us, id);
CREATE INDEX job_labels_by_label ON job_labels (label_key, value, job);
COMMIT;
