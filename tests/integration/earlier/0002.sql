BEGIN TRANSACTION;
CREATE TABLE alembic_version (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO "alembic_version" VALUES('0002');
CREATE TABLE api_keys (
	id VARCHAR(64) NOT NULL, 
	owner_id VARCHAR(64) NOT NULL, 
	name VARCHAR(100) NOT NULL, 
	secret_hash VARCHAR(64) NOT NULL, 
	created_at DATETIME NOT NULL, 
	last_used_at DATETIME, 
	revoked_at DATETIME, 
	requests_per_minute INTEGER, 
	max_active_jobs INTEGER, 
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
INSERT INTO "artifacts" VALUES('job_01m8appn1re9n8y07t36t2xy9g','result.glb',1,'model/gltf-binary',7,'cccccccccccccccccccccccccccccccccccccccccccccccccccccccccccccccc','jobs/x/1/result.glb','2026-11-26 01:14:45.157600');
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
INSERT INTO "events" VALUES('job_01m8appn15ezcs3ytwjqq25fkp',1,'queued','2026-11-26 01:14:45.161214',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8appn1beqxbjwyvsk9pfwvp',1,'queued','2026-11-26 01:14:45.164897',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8appn1beqxbjwyvsk9pfwvp',2,'started','2026-11-26 01:14:45.167724',1,'{}');
INSERT INTO "events" VALUES('job_01m8appn1hezpscrn9mvehdgdw',1,'queued','2026-11-26 01:14:45.170564',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8appn1hezpscrn9mvehdgdw',2,'started','2026-11-26 01:14:45.172338',1,'{}');
INSERT INTO "events" VALUES('job_01m8appn1hezpscrn9mvehdgdw',3,'canceling','2026-11-26 01:14:45.175467',1,'{}');
INSERT INTO "events" VALUES('job_01m8appn1re9n8y07t36t2xy9g',1,'queued','2026-11-26 01:14:45.177259',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8appn1re9n8y07t36t2xy9g',2,'started','2026-11-26 01:14:45.178969',1,'{}');
INSERT INTO "events" VALUES('job_01m8appn1re9n8y07t36t2xy9g',3,'succeeded','2026-11-26 01:14:45.182169',1,'{"artifacts": ["result.glb"]}');
INSERT INTO "events" VALUES('job_01m8appn23e2psrvg3kqv4qz1x',1,'queued','2026-11-26 01:14:45.188591',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8appn23e2psrvg3kqv4qz1x',2,'started','2026-11-26 01:14:45.192249',1,'{}');
INSERT INTO "events" VALUES('job_01m8appn23e2psrvg3kqv4qz1x',3,'failed','2026-11-26 01:14:45.201254',1,'{"error": {"code": "gpu_oom", "title": "t", "detail": "d", "advice": "a", "status": 500}}');
INSERT INTO "events" VALUES('job_01m8appn2qe6rbb1xr2kn8aj3x',1,'queued','2026-11-26 01:14:45.209387',0,'{"reason": "created"}');
INSERT INTO "events" VALUES('job_01m8appn2qe6rbb1xr2kn8aj3x',2,'canceled','2026-11-26 01:14:45.216403',0,'{}');
INSERT INTO "events" VALUES('job_01m8appn33ewmaxgvwc3322r76',1,'queued','2026-11-26 01:14:45.220680',0,'{"reason": "created"}');
CREATE TABLE files (
	"key" VARCHAR(255) NOT NULL, 
	pins INTEGER NOT NULL, 
	touched_at DATETIME NOT NULL, 
	CONSTRAINT pk_files PRIMARY KEY ("key")
);
INSERT INTO "files" VALUES('assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa',0,'2026-11-26 01:14:45.219428');
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
CREATE TABLE jobs (
	id VARCHAR(64) NOT NULL, 
	kind VARCHAR(32) NOT NULL, 
	state VARCHAR(16) NOT NULL, 
	request JSON NOT NULL, 
	asset_key VARCHAR(255) NOT NULL, 
	asset JSON NOT NULL, 
	target_key VARCHAR(255), 
	target JSON, 
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
	eta_s DOUBLE, owner_id VARCHAR(64) DEFAULT '' NOT NULL, workload VARCHAR(600) DEFAULT '' NOT NULL, origin_key VARCHAR(255), origin JSON, priority INTEGER DEFAULT '0' NOT NULL, deadline_at DATETIME, retention_s DOUBLE, retain_until DATETIME, request_id VARCHAR(128), traceparent VARCHAR(64), oom_attempts INTEGER DEFAULT '0' NOT NULL, event_seq INTEGER DEFAULT '0' NOT NULL, step_s DOUBLE, 
	CONSTRAINT pk_jobs PRIMARY KEY (id)
);
INSERT INTO "jobs" VALUES('job_01m8appn15ezcs3ytwjqq25fkp','text_deform','queued','{"prompt": "a vase", "params": {"preset": "preview", "seed": 7}}','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa','{"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}',NULL,NULL,NULL,'2026-11-26 01:14:45.157657',NULL,NULL,1,0,0,NULL,NULL,0,0,0.0,'queued','{}',NULL,'','text_deform/sds/',NULL,NULL,0,NULL,NULL,NULL,NULL,NULL,0,1,NULL);
INSERT INTO "jobs" VALUES('job_01m8appn1beqxbjwyvsk9pfwvp','text_deform','running','{"prompt": "a vase", "params": {"preset": "preview", "seed": 7}}','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa','{"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}',NULL,NULL,NULL,'2026-11-26 01:14:45.163828','2026-11-26 01:14:45.166081',NULL,2,1,0,'worker','2026-11-26 01:14:44.166159',0,0,0.0,'loading','{}',NULL,'','text_deform/sds/',NULL,NULL,0,NULL,NULL,NULL,NULL,NULL,0,2,NULL);
INSERT INTO "jobs" VALUES('job_01m8appn1hezpscrn9mvehdgdw','text_deform','canceling','{"prompt": "a vase", "params": {"preset": "preview", "seed": 7}}','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa','{"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}',NULL,NULL,NULL,'2026-11-26 01:14:45.169685','2026-11-26 01:14:45.171762',NULL,3,1,0,'worker','2026-11-26 01:14:44.171804',0,0,0.0,'loading','{}',NULL,'','text_deform/sds/',NULL,NULL,0,NULL,NULL,NULL,NULL,NULL,0,3,NULL);
INSERT INTO "jobs" VALUES('job_01m8appn1re9n8y07t36t2xy9g','text_deform','succeeded','{"prompt": "a vase", "params": {"preset": "preview", "seed": 7}}','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa','{"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}',NULL,NULL,NULL,'2026-11-26 01:14:45.176383','2026-11-26 01:14:45.178334','2026-11-26 01:14:45.180591',3,1,0,NULL,NULL,0,0,1.0,'done','{}',NULL,'','text_deform/sds/',NULL,NULL,0,NULL,NULL,NULL,NULL,NULL,0,3,NULL);
INSERT INTO "jobs" VALUES('job_01m8appn23e2psrvg3kqv4qz1x','text_deform','failed','{"prompt": "a vase", "params": {"preset": "preview", "seed": 7}}','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa','{"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}',NULL,NULL,'{"code": "gpu_oom", "title": "t", "detail": "d", "advice": "a", "status": 500}','2026-11-26 01:14:45.187207','2026-11-26 01:14:45.191189','2026-11-26 01:14:45.199415',3,1,0,NULL,NULL,0,0,0.0,'done','{}',NULL,'','text_deform/sds/',NULL,NULL,0,NULL,NULL,NULL,NULL,NULL,0,3,NULL);
INSERT INTO "jobs" VALUES('job_01m8appn2qe6rbb1xr2kn8aj3x','text_deform','canceled','{"prompt": "a vase", "params": {"preset": "preview", "seed": 7}}','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa','{"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}',NULL,NULL,NULL,'2026-11-26 01:14:45.207216',NULL,'2026-11-26 01:14:45.215617',2,0,0,NULL,NULL,0,0,0.0,'done','{}',NULL,'','text_deform/sds/',NULL,NULL,0,NULL,NULL,NULL,NULL,NULL,0,2,NULL);
INSERT INTO "jobs" VALUES('job_01m8appn33ewmaxgvwc3322r76','text_deform','queued','{"prompt": "a mushroom", "params": {"preset": "preview", "guidance": "sds", "steps": 300, "parametrization": "jacobians", "views": "orthogonal_grid", "seed": 0, "learning_rate": 0.0025, "translation_rate": 1.0, "guidance_scale": 100.0, "guidance_rescale": 0.7, "distillation": "sds", "ism_interval": 0.05, "ism_stride": 0.2, "noise_draws": 1, "optimizer": "adam", "rigidity": "identity", "safeguard": "intersections", "negative_prompt": "blurry, many heads", "negative": "unconditional", "negative_weight": 1.0, "view_prompts": false, "timestep_min": 0.02, "timestep_min_end": 0.02, "timestep_max": 0.98, "timestep_max_end": 0.98, "guidance_weight": 1.0, "jacobian_reg_weight": 0.1, "laplacian_weight": 0.1, "normal_weight": 0.1, "attachment_weight": 2000.0, "dirichlet_weight": 0.0, "learning_rate_end": 0.01, "regularizer_scale_end": 1.0, "annealing": "linear", "resolution_start": 0.5, "smoothing_start": 0.1, "coarse_until": 0.5, "stop_when_settled": 0.2, "candidates": 4, "candidate_steps": 25, "elevation_min_deg": 0.0, "elevation_max_deg": 30.0, "fov_min_deg": 30.0, "fov_max_deg": 45.0, "checkpoint_every_steps": 100}, "metadata": {"shot": "sc010"}}','assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa','{"key": "assets/aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "filename": "sphere.glb", "size": 3, "sha256": "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"}',NULL,NULL,NULL,'2026-11-26 01:14:45.219264',NULL,NULL,1,0,0,NULL,NULL,0,0,0.0,'queued','{}',NULL,'','text_deform/sds/',NULL,NULL,0,NULL,NULL,NULL,NULL,NULL,0,1,NULL);
CREATE TABLE labels (
	job_id VARCHAR(64) NOT NULL, 
	name VARCHAR(64) NOT NULL, 
	value VARCHAR(500) NOT NULL, 
	CONSTRAINT pk_labels PRIMARY KEY (job_id, name), 
	CONSTRAINT fk_labels_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);
INSERT INTO "labels" VALUES('job_01m8appn33ewmaxgvwc3322r76','shot','sc010');
CREATE TABLE outbox (
	job_id VARCHAR(64) NOT NULL, 
	created_at DATETIME NOT NULL, 
	CONSTRAINT pk_outbox PRIMARY KEY (job_id), 
	CONSTRAINT fk_outbox_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);
INSERT INTO "outbox" VALUES('job_01m8appn15ezcs3ytwjqq25fkp','2026-11-26 01:14:45.161908');
INSERT INTO "outbox" VALUES('job_01m8appn1beqxbjwyvsk9pfwvp','2026-11-26 01:14:45.165130');
INSERT INTO "outbox" VALUES('job_01m8appn1hezpscrn9mvehdgdw','2026-11-26 01:14:45.170775');
INSERT INTO "outbox" VALUES('job_01m8appn33ewmaxgvwc3322r76','2026-11-26 01:14:45.220905');
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
INSERT INTO "tallies" VALUES('queue_wait_seconds_sum','',1.02630000000000012883e-02);
INSERT INTO "tallies" VALUES('job_seconds_bucket','1',2.0);
INSERT INTO "tallies" VALUES('job_seconds_sum','',1.04830000000000009979e-02);
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
CREATE INDEX ix_jobs_asset_key ON jobs (asset_key);
CREATE INDEX ix_jobs_target_key ON jobs (target_key);
CREATE INDEX ix_jobs_owner_id_id ON jobs (owner_id, id);
CREATE INDEX ix_jobs_owner_id_state_id ON jobs (owner_id, state, id);
CREATE INDEX ix_jobs_origin_key ON jobs (origin_key);
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
COMMIT;
