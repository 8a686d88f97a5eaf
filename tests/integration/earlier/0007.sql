BEGIN TRANSACTION;
CREATE TABLE alembic_version (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO "alembic_version" VALUES('0007');
CREATE TABLE api_keys (
	id VARCHAR(64) NOT NULL, 
	owner_id VARCHAR(64) NOT NULL, 
	name VARCHAR(100) NOT NULL, 
	secret_hash VARCHAR(64) NOT NULL, 
	created_at DATETIME NOT NULL, 
	last_used_at DATETIME, 
	revoked_at DATETIME, 
	requests_per_minute INTEGER, 
	max_active_jobs INTEGER, max_priority INTEGER, 
	CONSTRAINT pk_api_keys PRIMARY KEY (id)
);
CREATE TABLE artifacts (
	job_id VARCHAR(64) NOT NULL, 
	name VARCHAR(128) NOT NULL, 
	attempt INTEGER NOT NULL, 
	content_type VARCHAR(128) NOT NULL, 
	size BIGINT NOT NULL, 
	sha256 VARCHAR(64) NOT NULL, 
	"key" VARCHAR(255) NOT NULL, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_artifacts PRIMARY KEY (job_id, name), 
	CONSTRAINT fk_artifacts_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);
INSERT INTO "artifacts" VALUES('job_01m8apppzbe558rqmzdaksad1b','result.glb',1,'model/gltf-binary',7,'cccccccccccccccccccccccccccccccccccccccccccccccccccccccccccccccc','jobs/x/1/result.glb','2026-11-26 01:14:47.090469');
CREATE TABLE checkpoints (
	job_id VARCHAR(64) NOT NULL, 
	attempt INTEGER NOT NULL, 
	step INTEGER NOT NULL, 
	sha256 VARCHAR(64) NOT NULL, 
	"key" VARCHAR(255) NOT NULL, size BIGINT DEFAULT '0' NOT NULL, mesh_key VARCHAR(255), mesh_sha256 VARCHAR(64), mesh_size BIGINT, created_at DATETIME DEFAULT '1970-01-01 00:00:00+00:00' NOT NULL, 
	CONSTRAINT pk_checkpoints PRIMARY KEY (job_id, attempt, step), 
	CONSTRAINT fk_checkpoints_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);
CREATE TABLE deliveries (
	id VARCHAR(64) NOT NULL, 
	webhook_id VARCHAR(64) NOT NULL, 
	job_id VARCHAR(64) NOT NULL, 
	replay_of VARCHAR(64), 
	type VARCHAR(64) NOT NULL, 
	payload JSON NOT NULL, 
	state VARCHAR(16) NOT NULL, 
	attempts INTEGER NOT NULL, 
	next_at DATETIME, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_deliveries PRIMARY KEY (id), 
	CONSTRAINT fk_deliveries_webhook_id FOREIGN KEY(webhook_id) REFERENCES webhooks (id) ON DELETE CASCADE
);
CREATE TABLE delivery_attempts (
	delivery_id VARCHAR(64) NOT NULL, 
	number INTEGER NOT NULL, 
	at DATETIME NOT NULL, 
	status INTEGER, 
	error VARCHAR(500), 
	seconds DOUBLE NOT NULL, 
	CONSTRAINT pk_delivery_attempts PRIMARY KEY (delivery_id, number), 
	CONSTRAINT fk_delivery_attempts_delivery_id FOREIGN KEY(delivery_id) REFERENCES deliveries (id) ON DELETE CASCADE
);
CREATE TABLE discarded (
	prefix VARCHAR(255) NOT NULL, 
	CONSTRAINT pk_discarded PRIMARY KEY (prefix)
);
CREATE TABLE events (
	job_id VARCHAR(64) NOT NULL, 
	seq INTEGER NOT NULL, 
	type VARCHAR(32) NOT NULL, 
	at DATETIME NOT NULL, 
	attempt INTEGER NOT NULL, 
	data JSON NOT NULL, 
	CONSTRAINT pk_events PRIMARY KEY (job_id, seq), 
	CONSTRAINT fk_events_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);
INSERT INTO "events" VALUES('job_01m8apppxje8jtxpntx7yqetgz',1,'queued','2026-11-26 01:14:47.099561',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8apppy7em2bczrqv3953rsj',1,'queued','2026-11-26 01:14:47.112927',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8apppy7em2bczrqv3953rsj',2,'started','2026-11-26 01:14:47.121566',1,'{}');
INSERT INTO "events" VALUES('job_01m8apppymexbbzmkr2tjvb0j4',1,'queued','2026-11-26 01:14:47.125572',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8apppymexbbzmkr2tjvb0j4',2,'started','2026-11-26 01:14:47.132691',1,'{}');
INSERT INTO "events" VALUES('job_01m8apppymexbbzmkr2tjvb0j4',3,'canceling','2026-11-26 01:14:47.141420',1,'{}');
INSERT INTO "events" VALUES('job_01m8apppzbe558rqmzdaksad1b',1,'queued','2026-11-26 01:14:47.148678',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8apppzbe558rqmzdaksad1b',2,'started','2026-11-26 01:14:47.151983',1,'{}');
INSERT INTO "events" VALUES('job_01m8apppzbe558rqmzdaksad1b',3,'succeeded','2026-11-26 01:14:47.161929',1,'{"artifacts": ["result.glb"]}');
INSERT INTO "events" VALUES('job_01m8appq0benwb0z3gby23t8w9',1,'queued','2026-11-26 01:14:47.180645',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8appq0benwb0z3gby23t8w9',2,'started','2026-11-26 01:14:47.183951',1,'{}');
INSERT INTO "events" VALUES('job_01m8appq0benwb0z3gby23t8w9',3,'failed','2026-11-26 01:14:47.193450',1,'{"error": {"code": "gpu_oom", "title": "t", "detail": "d", "advice": "a", "status": 500}}');
INSERT INTO "events" VALUES('job_01m8appq0veyabvy1y2pxjc5rx',1,'queued','2026-11-26 01:14:47.196602',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8appq0veyabvy1y2pxjc5rx',2,'canceled','2026-11-26 01:14:47.198499',0,'{}');
INSERT INTO "events" VALUES('job_01m8appq10en3rndttjsm8051g',1,'queued','2026-11-26 01:14:47.201643',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8appq1be4jbfttt50mwja33',1,'queued','2026-11-26 01:14:47.212638',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8appq1fezt97mkn0pzjrrse',1,'queued','2026-11-26 01:14:47.216220',0,'{"reason": "created"}');
CREATE TABLE files (
	"key" VARCHAR(255) NOT NULL, 
	pins INTEGER NOT NULL, 
	touched_at DATETIME NOT NULL, 
	CONSTRAINT pk_files PRIMARY KEY ("key")
);
INSERT INTO "files" VALUES('assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',0,'2026-11-26 01:14:47.215319');
CREATE TABLE idempotency (
	owner_id VARCHAR(64) NOT NULL, 
	"key" VARCHAR(255) NOT NULL, 
	request_hash VARCHAR(64) NOT NULL, 
	token VARCHAR(32) NOT NULL, 
	locked_until DATETIME NOT NULL, 
	response JSON, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_idempotency PRIMARY KEY (owner_id, "key")
);
CREATE TABLE job_files (
	job_id VARCHAR(64) NOT NULL, 
	part VARCHAR(64) NOT NULL, 
	owner_id VARCHAR(64) NOT NULL, 
	"key" VARCHAR(255) NOT NULL, 
	size BIGINT NOT NULL, 
	CONSTRAINT pk_job_files PRIMARY KEY (job_id, part), 
	CONSTRAINT fk_job_files_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);
INSERT INTO "job_files" VALUES('job_01m8apppxje8jtxpntx7yqetgz','asset','','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',3);
INSERT INTO "job_files" VALUES('job_01m8apppy7em2bczrqv3953rsj','asset','','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',3);
INSERT INTO "job_files" VALUES('job_01m8apppymexbbzmkr2tjvb0j4','asset','','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',3);
INSERT INTO "job_files" VALUES('job_01m8apppzbe558rqmzdaksad1b','asset','','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',3);
INSERT INTO "job_files" VALUES('job_01m8appq0benwb0z3gby23t8w9','asset','','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',3);
INSERT INTO "job_files" VALUES('job_01m8appq0veyabvy1y2pxjc5rx','asset','','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',3);
INSERT INTO "job_files" VALUES('job_01m8appq10en3rndttjsm8051g','asset','','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',3);
INSERT INTO "job_files" VALUES('job_01m8appq1be4jbfttt50mwja33','asset','','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',3);
INSERT INTO "job_files" VALUES('job_01m8appq1fezt97mkn0pzjrrse','asset','','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',3);
CREATE TABLE job_texts (
	job_id VARCHAR(64) NOT NULL, 
	text TEXT NOT NULL, 
	CONSTRAINT pk_job_texts PRIMARY KEY (job_id), 
	CONSTRAINT fk_job_texts_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);
INSERT INTO "job_texts" VALUES('job_01m8apppxje8jtxpntx7yqetgz','a vase
sphere.glb');
INSERT INTO "job_texts" VALUES('job_01m8apppy7em2bczrqv3953rsj','a vase
sphere.glb');
INSERT INTO "job_texts" VALUES('job_01m8apppymexbbzmkr2tjvb0j4','a vase
sphere.glb');
INSERT INTO "job_texts" VALUES('job_01m8apppzbe558rqmzdaksad1b','a vase
sphere.glb');
INSERT INTO "job_texts" VALUES('job_01m8appq0benwb0z3gby23t8w9','a vase
sphere.glb');
INSERT INTO "job_texts" VALUES('job_01m8appq0veyabvy1y2pxjc5rx','a vase
sphere.glb');
INSERT INTO "job_texts" VALUES('job_01m8appq10en3rndttjsm8051g','a mushroom
a rabbit
a pear

a mushroom

a shark
sphere.glb
sc010');
INSERT INTO "job_texts" VALUES('job_01m8appq1be4jbfttt50mwja33','
sphere.glb');
INSERT INTO "job_texts" VALUES('job_01m8appq1fezt97mkn0pzjrrse','
sphere.glb');
CREATE TABLE jobs (
	id VARCHAR(64) NOT NULL, 
	kind VARCHAR(32) NOT NULL, 
	state VARCHAR(16) NOT NULL, 
	request JSON NOT NULL, 
	error JSON, 
	created_at DATETIME NOT NULL, 
	started_at DATETIME, 
	finished_at DATETIME, 
	version INTEGER NOT NULL, 
	attempt INTEGER NOT NULL, 
	lost_attempts INTEGER NOT NULL, 
	worker_id VARCHAR(255), 
	lease_expires_at DATETIME, 
	step INTEGER NOT NULL, 
	total_steps INTEGER NOT NULL, 
	fraction DOUBLE NOT NULL, 
	phase VARCHAR(64) NOT NULL, 
	losses JSON NOT NULL, 
	eta_s DOUBLE, owner_id VARCHAR(64) DEFAULT '' NOT NULL, workload VARCHAR(600) DEFAULT '' NOT NULL, origin JSON, priority INTEGER DEFAULT '0' NOT NULL, deadline_at DATETIME, retention_s DOUBLE, retain_until DATETIME, request_id VARCHAR(128), traceparent VARCHAR(64), oom_attempts INTEGER DEFAULT '0' NOT NULL, event_seq INTEGER DEFAULT '0' NOT NULL, step_s DOUBLE, resolved JSON, files JSON DEFAULT '{}' NOT NULL, stored_bytes BIGINT DEFAULT '0' NOT NULL, 
	CONSTRAINT pk_jobs PRIMARY KEY (id)
);
INSERT INTO "jobs" VALUES('job_01m8apppxje8jtxpntx7yqetgz','text_deform','queued','{"prompt": "a vase", "params": {"preset": "preview", "seed": 7}}',NULL,'2026-11-26 01:14:47.090550',NULL,NULL,1,0,0,NULL,NULL,0,0,0.0,'queued','{}',NULL,'','text_deform/sds/',NULL,0,NULL,NULL,NULL,NULL,NULL,0,1,NULL,NULL,'{"asset": {"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}}',0);
INSERT INTO "jobs" VALUES('job_01m8apppy7em2bczrqv3953rsj','text_deform','running','{"prompt": "a vase", "params": {"preset": "preview", "seed": 7}}',NULL,'2026-11-26 01:14:47.111299','2026-11-26 01:14:47.119297',NULL,2,1,0,'worker','2026-11-26 01:14:46.119399',0,0,0.0,'loading','{}',NULL,'','text_deform/sds/',NULL,0,NULL,NULL,NULL,NULL,NULL,0,2,NULL,NULL,'{"asset": {"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}}',0);
INSERT INTO "jobs" VALUES('job_01m8apppymexbbzmkr2tjvb0j4','text_deform','canceling','{"prompt": "a vase", "params": {"preset": "preview", "seed": 7}}',NULL,'2026-11-26 01:14:47.124330','2026-11-26 01:14:47.131525',NULL,3,1,0,'worker','2026-11-26 01:14:46.131621',0,0,0.0,'loading','{}',NULL,'','text_deform/sds/',NULL,0,NULL,NULL,NULL,NULL,NULL,0,3,NULL,NULL,'{"asset": {"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}}',0);
INSERT INTO "jobs" VALUES('job_01m8apppzbe558rqmzdaksad1b','text_deform','succeeded','{"prompt": "a vase", "params": {"preset": "preview", "seed": 7}}',NULL,'2026-11-26 01:14:47.147232','2026-11-26 01:14:47.151239','2026-11-26 01:14:47.159764',3,1,0,NULL,NULL,0,0,1.0,'done','{}',NULL,'','text_deform/sds/',NULL,0,NULL,NULL,NULL,NULL,NULL,0,3,NULL,NULL,'{"asset": {"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}}',7);
INSERT INTO "jobs" VALUES('job_01m8appq0benwb0z3gby23t8w9','text_deform','failed','{"prompt": "a vase", "params": {"preset": "preview", "seed": 7}}','{"code": "gpu_oom", "title": "t", "detail": "d", "advice": "a", "status": 500}','2026-11-26 01:14:47.179250','2026-11-26 01:14:47.183200','2026-11-26 01:14:47.191357',3,1,0,NULL,NULL,0,0,0.0,'done','{}',NULL,'','text_deform/sds/',NULL,0,NULL,NULL,NULL,NULL,NULL,0,3,NULL,NULL,'{"asset": {"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}}',0);
INSERT INTO "jobs" VALUES('job_01m8appq0veyabvy1y2pxjc5rx','text_deform','canceled','{"prompt": "a vase", "params": {"preset": "preview", "seed": 7}}',NULL,'2026-11-26 01:14:47.195438',NULL,'2026-11-26 01:14:47.197977',2,0,0,NULL,NULL,0,0,0.0,'done','{}',NULL,'','text_deform/sds/',NULL,0,NULL,NULL,NULL,NULL,NULL,0,2,NULL,NULL,'{"asset": {"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}}',0);
INSERT INTO "jobs" VALUES('job_01m8appq10en3rndttjsm8051g','text_deform','queued','{"prompt": "a mushroom", "params": {"preset": "preview", "guidance": "sds", "steps": 300, "seed": 0, "learning_rate": 0.0025, "carrier": "auto", "orientation": "auto", "appearance": "mixed", "exclude": ["Ground"], "backdrop": "leave", "rigid": [{"node": "wheel-front-left"}, {"material": "rubber", "mode": "similarity"}], "regions": [{"node": "Hinge"}, {"box": {"min": [0.0, 1.0, -1.0], "max": [1.0, 2.0, 1.0]}, "action": "only"}], "falloff": 0.1, "handles": [{"position": [0.0, 1.0, 0.0], "to": [0.0, 1.5, 0.0]}], "symmetry": "auto", "length": {"x": "keep", "y": {"max": 1.2}}, "prompts": [{"prompt": "a rabbit", "weight": 0.5}], "guidance_scale": 100.0, "guidance_rescale": 0.7, "safeguard": "intersections", "negative_prompt": "blurry, many heads", "timestep_min": 0.02, "timestep_max": 0.98, "timestep_max_end": 0.98, "guidance_weight": 1.0, "jacobian_reg_weight": 0.1, "laplacian_weight": 0.1, "normal_weight": 0.1, "dirichlet_weight": 0.0, "align": "auto", "target": {"prompt": "a shark", "model": "/models/shap-e"}, "stages": [{"prompt": "a pear"}, {"prompt": "a mushroom"}], "landmarks": [{"source": 120, "target": [0.1, 0.9, 0.5]}], "point_weight": 1.0, "silhouettes": [{"azimuth": 0.0}, {"azimuth": 90.0}], "silhouette_weight": 10.0, "stiffness": 10.0, "framing": 0.9, "framing_max": 0.9, "elevation_min_deg": 0.0, "elevation_max_deg": 30.0, "fov_min_deg": 30.0, "fov_max_deg": 45.0, "checkpoint_every_steps": 100}, "metadata": {"shot": "sc010"}}',NULL,'2026-11-26 01:14:47.200052',NULL,NULL,1,0,0,NULL,NULL,0,0,0.0,'queued','{}',NULL,'','text_deform/sds//2 prompts, 0 regions',NULL,0,NULL,NULL,NULL,NULL,NULL,0,1,NULL,NULL,'{"asset": {"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}}',0);
INSERT INTO "jobs" VALUES('job_01m8appq1be4jbfttt50mwja33','surface_fit','queued','{"kind": "surface_fit", "params": {"steps": 10}}',NULL,'2026-11-26 01:14:47.211293',NULL,NULL,1,0,0,NULL,NULL,0,0,0.0,'queued','{}',NULL,'','surface_fit//',NULL,0,NULL,NULL,NULL,NULL,NULL,0,1,NULL,NULL,'{"asset": {"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}}',0);
INSERT INTO "jobs" VALUES('job_01m8appq1fezt97mkn0pzjrrse','family_fit','queued','{"kind": "family_fit"}',NULL,'2026-11-26 01:14:47.215198',NULL,NULL,1,0,0,NULL,NULL,0,0,0.0,'queued','{}',NULL,'','family_fit//',NULL,0,NULL,NULL,NULL,NULL,NULL,0,1,NULL,NULL,'{"asset": {"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}}',0);
CREATE TABLE labels (
	job_id VARCHAR(64) NOT NULL, 
	name VARCHAR(64) NOT NULL, 
	value VARCHAR(500) NOT NULL, 
	CONSTRAINT pk_labels PRIMARY KEY (job_id, name), 
	CONSTRAINT fk_labels_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);
INSERT INTO "labels" VALUES('job_01m8appq10en3rndttjsm8051g','shot','sc010');
CREATE TABLE outbox (
	job_id VARCHAR(64) NOT NULL, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_outbox PRIMARY KEY (job_id), 
	CONSTRAINT fk_outbox_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);
INSERT INTO "outbox" VALUES('job_01m8apppxje8jtxpntx7yqetgz','2026-11-26 01:14:47.100333');
INSERT INTO "outbox" VALUES('job_01m8apppy7em2bczrqv3953rsj','2026-11-26 01:14:47.113156');
INSERT INTO "outbox" VALUES('job_01m8apppymexbbzmkr2tjvb0j4','2026-11-26 01:14:47.125770');
INSERT INTO "outbox" VALUES('job_01m8appq10en3rndttjsm8051g','2026-11-26 01:14:47.201843');
INSERT INTO "outbox" VALUES('job_01m8appq1be4jbfttt50mwja33','2026-11-26 01:14:47.212835');
INSERT INTO "outbox" VALUES('job_01m8appq1fezt97mkn0pzjrrse','2026-11-26 01:14:47.216399');
CREATE TABLE secrets (
	name VARCHAR(64) NOT NULL, 
	value VARCHAR(128) NOT NULL, 
	CONSTRAINT pk_secrets PRIMARY KEY (name)
);
CREATE TABLE tallies (
	name VARCHAR(64) NOT NULL, 
	label VARCHAR(64) NOT NULL, 
	value DOUBLE NOT NULL, 
	CONSTRAINT pk_tallies PRIMARY KEY (name, label)
);
INSERT INTO "tallies" VALUES('queue_wait_seconds_bucket','0.1',4.0);
INSERT INTO "tallies" VALUES('queue_wait_seconds_sum','',2.31500000000000039079e-02);
INSERT INTO "tallies" VALUES('job_seconds_bucket','1',2.0);
INSERT INTO "tallies" VALUES('job_seconds_sum','',0.016682);
INSERT INTO "tallies" VALUES('jobs_ended','succeeded',1.0);
INSERT INTO "tallies" VALUES('jobs_ended','failed',1.0);
INSERT INTO "tallies" VALUES('jobs_ended','canceled',1.0);
CREATE TABLE uploads (
	id VARCHAR(64) NOT NULL, 
	owner_id VARCHAR(64) NOT NULL, 
	filename VARCHAR(200) NOT NULL, 
	size BIGINT NOT NULL, 
	sha256 VARCHAR(64), 
	"key" VARCHAR(255), 
	created_at DATETIME NOT NULL, 
	expires_at DATETIME NOT NULL, 
	CONSTRAINT pk_uploads PRIMARY KEY (id)
);
CREATE TABLE webhooks (
	id VARCHAR(64) NOT NULL, 
	owner_id VARCHAR(64) NOT NULL, 
	url VARCHAR(2000) NOT NULL, 
	events JSON NOT NULL, 
	secret VARCHAR(128) NOT NULL, 
	previous_secret VARCHAR(128), 
	previous_until DATETIME, 
	disabled_at DATETIME, 
	disabled_reason VARCHAR(255), 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_webhooks PRIMARY KEY (id)
);
CREATE TABLE workers (
	id VARCHAR(255) NOT NULL, 
	queue VARCHAR(255) NOT NULL, 
	device VARCHAR(32) NOT NULL, 
	started_at DATETIME NOT NULL, 
	seen_at DATETIME NOT NULL, 
	CONSTRAINT pk_workers PRIMARY KEY (id)
);
CREATE INDEX ix_jobs_state_id ON jobs (state, id);
CREATE INDEX ix_jobs_owner_id_id ON jobs (owner_id, id);
CREATE INDEX ix_jobs_owner_id_state_id ON jobs (owner_id, state, id);
CREATE INDEX ix_jobs_workload_state_id ON jobs (workload, state, id);
CREATE INDEX ix_jobs_deadline_at ON jobs (deadline_at);
CREATE INDEX ix_jobs_retain_until ON jobs (retain_until);
CREATE INDEX ix_jobs_worker_id ON jobs (worker_id);
CREATE INDEX ix_jobs_urgency ON jobs (state, priority DESC, id);
CREATE INDEX ix_labels_name_value_job_id ON labels (name, value, job_id);
CREATE INDEX ix_idempotency_created_at ON idempotency (created_at);
CREATE INDEX ix_uploads_key ON uploads ("key");
CREATE INDEX ix_uploads_expires_at ON uploads (expires_at);
CREATE INDEX ix_webhooks_owner_id_id ON webhooks (owner_id, id);
CREATE INDEX ix_deliveries_state_next_at ON deliveries (state, next_at);
CREATE INDEX ix_deliveries_webhook_id_id ON deliveries (webhook_id, id);
CREATE INDEX ix_deliveries_created_at_state ON deliveries (created_at, state);
CREATE INDEX ix_jobs_share ON jobs (state, priority, owner_id, id);
CREATE INDEX ix_job_files_key ON job_files ("key");
CREATE INDEX ix_job_files_owner_id_key_size ON job_files (owner_id, "key", size);
CREATE INDEX ix_jobs_owner_id_stored_bytes ON jobs (owner_id, stored_bytes);
COMMIT;
