// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file schema.hpp
/// The tables of a farm. Times are wall-clock ms since 1970 unless a name says "steady".
#pragma once

namespace slicecorr::farm::detail {

/// PRAGMA user_version. A database with a higher number is refused; a lower one is brought up.
inline constexpr int kSchemaVersion = 7;

/// PRAGMA kApplicationId, "SCFM": not every SQLite file is a farm.
inline constexpr int kApplicationId = 0x5343464d;

inline constexpr const char* kSchema = R"sql(
-- Printer, resin and process as stacks record them, once for all jobs that share them.
CREATE TABLE setups(hash TEXT PRIMARY KEY, json TEXT NOT NULL) WITHOUT ROWID;

-- What is to be done, once for all jobs with the same output.
CREATE TABLE works(
  key TEXT PRIMARY KEY,            -- SHA-256 of input bytes, parameters and program version
  spec TEXT NOT NULL,              -- WorkSpec as JSON
  setup TEXT NOT NULL REFERENCES setups(hash),
  kind TEXT NOT NULL, printer TEXT NOT NULL, resin TEXT NOT NULL, format TEXT NOT NULL,
  rate_class TEXT NOT NULL,        -- work of the same class takes the same time per unit
  layers INTEGER NOT NULL, voxels INTEGER NOT NULL,
  base_memory_mb INTEGER NOT NULL, thread_memory_mb INTEGER NOT NULL
) WITHOUT ROWID;

-- Inputs in the store that works name.
CREATE TABLE inputs(file TEXT PRIMARY KEY, bytes INTEGER NOT NULL, added_ms INTEGER NOT NULL)
  WITHOUT ROWID;
CREATE TABLE work_inputs(key TEXT NOT NULL, file TEXT NOT NULL, PRIMARY KEY(key, file))
  WITHOUT ROWID;
CREATE INDEX work_inputs_by_file ON work_inputs(file);

CREATE TABLE batches(
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  submitted_ms INTEGER NOT NULL, user TEXT NOT NULL, source TEXT NOT NULL, jobs INTEGER NOT NULL);

CREATE TABLE jobs(
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  batch INTEGER NOT NULL REFERENCES batches(id),
  state TEXT NOT NULL CHECK(state IN ('queued', 'running', 'done', 'failed', 'cancelled')),
  reason TEXT NOT NULL DEFAULT '', message TEXT NOT NULL DEFAULT '',
  name TEXT NOT NULL, user TEXT NOT NULL, labels TEXT NOT NULL,  -- labels: JSON array
  parts TEXT NOT NULL,                                           -- JSON array
  priority INTEGER NOT NULL, ready_by_ms INTEGER NOT NULL,
  key TEXT NOT NULL REFERENCES works(key),
  follows INTEGER NOT NULL DEFAULT 0,   -- job with the same key that is done first; 0: none
  output_folder TEXT NOT NULL,
  expected_s REAL NOT NULL, expected_bytes INTEGER NOT NULL,
  attempts INTEGER NOT NULL DEFAULT 0, memory_failures INTEGER NOT NULL DEFAULT 0,
  delays INTEGER NOT NULL DEFAULT 0,    -- attempts that were put back without being counted
  not_before_ms INTEGER NOT NULL DEFAULT 0,
  token TEXT NOT NULL DEFAULT '',       -- of the present attempt: what every change compares
  cancel_wanted INTEGER NOT NULL DEFAULT 0,
  from_cache INTEGER NOT NULL DEFAULT 0,
  submitted_ms INTEGER NOT NULL, started_ms INTEGER NOT NULL DEFAULT 0,
  ended_ms INTEGER NOT NULL DEFAULT 0,
  files TEXT NOT NULL DEFAULT '',       -- as delivered, JSON
  CHECK((state = 'running') = (token <> '')));
CREATE INDEX jobs_to_claim ON jobs(priority DESC, ready_by_ms, id, user, not_before_ms, key)
  WHERE state = 'queued' AND follows = 0;
-- For lists of what comes next, followers included.
CREATE INDEX jobs_queued ON jobs(priority DESC, ready_by_ms, id, follows, expected_s)
  WHERE state = 'queued';
CREATE INDEX jobs_by_state ON jobs(state, ended_ms);
CREATE INDEX jobs_by_key ON jobs(key, state);
CREATE INDEX jobs_followers ON jobs(follows) WHERE follows <> 0;
CREATE INDEX jobs_by_batch ON jobs(batch);
CREATE INDEX jobs_unfinished_outputs ON jobs(output_folder, name) WHERE state IN ('queued', 'running');

-- Counts kept by triggers, so that a status of 100,000 jobs reads a few rows.
CREATE TABLE counts(
  user TEXT NOT NULL, state TEXT NOT NULL, follower INTEGER NOT NULL,
  jobs INTEGER NOT NULL, expected_s REAL NOT NULL, from_cache INTEGER NOT NULL,
  PRIMARY KEY(user, state, follower)) WITHOUT ROWID;
CREATE TRIGGER jobs_added AFTER INSERT ON jobs BEGIN
  INSERT INTO counts VALUES(new.user, new.state, new.follows <> 0, 1, new.expected_s, new.from_cache)
  ON CONFLICT DO UPDATE SET jobs = jobs + 1, expected_s = expected_s + excluded.expected_s,
    from_cache = from_cache + excluded.from_cache;
END;
CREATE TRIGGER jobs_moved AFTER UPDATE OF state, follows, from_cache ON jobs
  WHEN old.state <> new.state OR (old.follows <> 0) <> (new.follows <> 0)
    OR old.from_cache <> new.from_cache BEGIN
  UPDATE counts SET jobs = jobs - 1, expected_s = expected_s - old.expected_s,
    from_cache = from_cache - old.from_cache
    WHERE user = old.user AND state = old.state AND follower = (old.follows <> 0);
  INSERT INTO counts VALUES(new.user, new.state, new.follows <> 0, 1, new.expected_s, new.from_cache)
  ON CONFLICT DO UPDATE SET jobs = jobs + 1, expected_s = expected_s + excluded.expected_s,
    from_cache = from_cache + excluded.from_cache;
END;

CREATE TABLE attempts(
  token TEXT PRIMARY KEY,
  job INTEGER NOT NULL REFERENCES jobs(id), number INTEGER NOT NULL,
  engine TEXT NOT NULL, engine_id TEXT NOT NULL DEFAULT '',
  service TEXT NOT NULL, node TEXT NOT NULL DEFAULT '',
  threads INTEGER NOT NULL DEFAULT 0, memory_mb INTEGER NOT NULL DEFAULT 0,
  phase TEXT NOT NULL CHECK(phase IN ('waiting', 'working', 'committing', 'ended')),
  lease_boot TEXT NOT NULL, lease_until_steady_ms INTEGER NOT NULL,
  stage TEXT NOT NULL DEFAULT '', fraction REAL NOT NULL DEFAULT 0,
  layers_done INTEGER NOT NULL DEFAULT 0,
  started_ms INTEGER NOT NULL, ended_ms INTEGER NOT NULL DEFAULT 0,
  reason TEXT NOT NULL DEFAULT '', message TEXT NOT NULL DEFAULT '', exit_code INTEGER NOT NULL DEFAULT -1,
  wall_s REAL NOT NULL DEFAULT 0, cpu_s REAL NOT NULL DEFAULT 0, peak_mb INTEGER NOT NULL DEFAULT 0,
  log TEXT NOT NULL DEFAULT '') WITHOUT ROWID;
CREATE INDEX attempts_by_job ON attempts(job, number);
CREATE INDEX attempts_open ON attempts(service) WHERE phase <> 'ended';

-- Sums of attempts that ended, kept by a trigger as counts are.
CREATE TABLE attempt_totals(
  reason TEXT NOT NULL, engine TEXT NOT NULL, attempts INTEGER NOT NULL,
  wall_s REAL NOT NULL, cpu_s REAL NOT NULL, voxels REAL NOT NULL,
  PRIMARY KEY(reason, engine)) WITHOUT ROWID;
CREATE TRIGGER attempts_ended AFTER UPDATE OF phase ON attempts
  WHEN new.phase = 'ended' AND old.phase <> 'ended' BEGIN
  INSERT INTO attempt_totals VALUES(new.reason, new.engine, 1, new.wall_s, new.cpu_s,
    (SELECT w.voxels FROM jobs j JOIN works w ON w.key = j.key WHERE j.id = new.job))
  ON CONFLICT DO UPDATE SET attempts = attempts + 1, wall_s = wall_s + excluded.wall_s,
    cpu_s = cpu_s + excluded.cpu_s, voxels = voxels + excluded.voxels;
END;

-- Results by key; the figures stay when the files are collected.
CREATE TABLE results(
  key TEXT PRIMARY KEY REFERENCES works(key),
  stored INTEGER NOT NULL,              -- 1: the files are in the cache
  files TEXT NOT NULL, bytes INTEGER NOT NULL, program TEXT NOT NULL,
  made_ms INTEGER NOT NULL, used_ms INTEGER NOT NULL, wall_s REAL NOT NULL,
  layers INTEGER NOT NULL, height_mean_um REAL NOT NULL, height_p95_um REAL NOT NULL,
  height_max_um REAL NOT NULL, lost_features INTEGER NOT NULL, merged_features INTEGER NOT NULL,
  cure_through_voxels INTEGER NOT NULL, undercure_voxels INTEGER NOT NULL,
  target_voxels INTEGER NOT NULL) WITHOUT ROWID;
CREATE INDEX results_stored ON results(used_ms, bytes, stored) WHERE stored;
CREATE INDEX results_by_height ON results(height_max_um DESC);

CREATE TABLE services(
  id TEXT PRIMARY KEY, engine TEXT NOT NULL, host TEXT NOT NULL, pid INTEGER NOT NULL,
  process_start INTEGER NOT NULL,       -- tells a reused pid from the service's own
  boot TEXT NOT NULL, cores INTEGER NOT NULL, memory_mb INTEGER NOT NULL,
  started_ms INTEGER NOT NULL, seen_ms INTEGER NOT NULL, stopped_ms INTEGER NOT NULL DEFAULT 0,
  doing TEXT NOT NULL DEFAULT '') WITHOUT ROWID;

CREATE TABLE settings(name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;

-- Measured: sums over attempts that succeeded, older ones fading. Of tomographic prints `voxels` are
-- their voxel_angle_steps.
CREATE TABLE rates(
  rate_class TEXT PRIMARY KEY, samples INTEGER NOT NULL, voxels REAL NOT NULL, core_s REAL NOT NULL,
  bytes REAL NOT NULL) WITHOUT ROWID;

CREATE TABLE events(
  seq INTEGER PRIMARY KEY AUTOINCREMENT, at_ms INTEGER NOT NULL,
  job INTEGER NOT NULL DEFAULT 0, attempt TEXT NOT NULL DEFAULT '',
  kind TEXT NOT NULL, reason TEXT NOT NULL DEFAULT '', text TEXT NOT NULL);
CREATE INDEX events_by_job ON events(job, seq);
CREATE TRIGGER events_stay AFTER UPDATE ON events BEGIN
  SELECT RAISE(ABORT, 'events are append-only');
END;
CREATE TRIGGER events_remain BEFORE DELETE ON events BEGIN
  SELECT RAISE(ABORT, 'events are append-only');
END;
)sql";

/// What version 2 has besides. Tables of their own, so that programs that know version 1 and have
/// the record open go on.
inline constexpr const char* kSchemaOfTomography = R"sql(
-- What the time of tomographic prints goes with: voxels times angles times steps.
CREATE TABLE tomo_works(key TEXT PRIMARY KEY REFERENCES works(key), voxel_angle_steps INTEGER NOT NULL)
  WITHOUT ROWID;
-- Figures of tomographic prints, beside their row in results; contrast and its bound may be infinite.
CREATE TABLE tomo_results(
  key TEXT PRIMARY KEY REFERENCES works(key),
  contrast REAL NOT NULL, contrast_bound REAL NOT NULL, ver REAL NOT NULL, turns INTEGER NOT NULL,
  print_time_s REAL NOT NULL, feasible INTEGER NOT NULL) WITHOUT ROWID;
CREATE INDEX tomo_results_by_contrast ON tomo_results(contrast);
)sql";

/// What version 3 has besides, in the same way.
inline constexpr const char* kSchemaOfTimes = R"sql(
-- How long stacks print, beside their row in results; print_s is null where lifts are not known.
CREATE TABLE stack_times(
  key TEXT PRIMARY KEY REFERENCES works(key), light_s REAL NOT NULL, print_s REAL) WITHOUT ROWID;
)sql";

/// What version 4 has besides, in the same way.
inline constexpr const char* kSchemaOfVerdicts = R"sql(
-- What prints come to, in words, beside their row in results.
CREATE TABLE stack_verdicts(
  key TEXT PRIMARY KEY REFERENCES works(key), outcome TEXT NOT NULL, words TEXT NOT NULL)
  WITHOUT ROWID;
)sql";

/// What version 5 has besides, in the same way.
inline constexpr const char* kSchemaOfScans = R"sql(
-- Scans of prints, in the order in which they came. Deviations are those from what was predicted.
CREATE TABLE scans(
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  job INTEGER NOT NULL REFERENCES jobs(id), number INTEGER NOT NULL,
  folder TEXT NOT NULL,                 -- below scans/, a random name
  file TEXT NOT NULL, bytes INTEGER NOT NULL, user TEXT NOT NULL, at_ms INTEGER NOT NULL,
  unit TEXT NOT NULL, voxel_um REAL NOT NULL, points INTEGER NOT NULL, with_design INTEGER NOT NULL,
  mean_um REAL NOT NULL, mean_abs_um REAL NOT NULL, p95_um REAL NOT NULL, worst_um REAL NOT NULL,
  unseen_share REAL NOT NULL,
  removed INTEGER NOT NULL DEFAULT 0,   -- 1: its files are gone
  UNIQUE(job, number));
-- Jobs that were corrected with what scans of another one told.
CREATE TABLE scan_nexts(
  job INTEGER PRIMARY KEY REFERENCES jobs(id), of_job INTEGER NOT NULL REFERENCES jobs(id),
  before_mean_um REAL NOT NULL, before_p95_um REAL NOT NULL, words TEXT NOT NULL);
)sql";

/// What version 6 has besides: with a million queued jobs lists come in the time of a few rows.
inline constexpr const char* kSchemaOfLongQueues = R"sql(
CREATE INDEX jobs_in_state ON jobs(state);
CREATE INDEX jobs_of_user ON jobs(user, id, state);
CREATE INDEX jobs_queued_of_user ON jobs(user, priority DESC, ready_by_ms, id) WHERE state = 'queued';
-- The labels of jobs, which never change.
CREATE TABLE job_labels(label TEXT NOT NULL, job INTEGER NOT NULL, PRIMARY KEY(label, job)) WITHOUT ROWID;
INSERT OR IGNORE INTO job_labels SELECT e.value, j.id FROM jobs j, json_each(j.labels) e;
CREATE TRIGGER jobs_labelled AFTER INSERT ON jobs WHEN new.labels <> '[]' BEGIN
  INSERT OR IGNORE INTO job_labels SELECT value, new.id FROM json_each(new.labels);
END;
)sql";

/// What version 7 has besides: words are found in names and inputs, which never change, without looking at all jobs.
inline constexpr const char* kSchemaOfWords = R"sql(
-- Which jobs have which three letters one after the other in their name or inputs. The ends of lines at the end make
-- each letter the first of three. (On one line: docs/farm-backup.md leaves lines out of a dump.)
CREATE VIRTUAL TABLE job_words USING fts5(text, content = '', columnsize = 0, detail = none, tokenize = 'trigram case_sensitive 1');
-- Each three letters (term) with each job (doc) that has them.
CREATE VIRTUAL TABLE job_letters USING fts5vocab(job_words, instance);
-- Less is put together anew at each submission than by default.
INSERT INTO job_words(job_words, rank) VALUES('automerge', 8);
INSERT INTO job_words(rowid, text)
  SELECT id, name || char(10) || parts || char(10, 10) FROM jobs;
INSERT INTO job_words(job_words) VALUES('optimize');
CREATE TRIGGER jobs_worded AFTER INSERT ON jobs BEGIN
  INSERT INTO job_words(rowid, text) VALUES(new.id, new.name || char(10) || new.parts || char(10, 10));
END;
-- For words that so many jobs have that all are looked at.
CREATE INDEX jobs_texts ON jobs(state, user, name, parts);
)sql";

}  // namespace slicecorr::farm::detail
