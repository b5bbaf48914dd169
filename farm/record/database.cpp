// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "record/database.hpp"

#include <fmt/format.h>
#include <sqlite3.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

#include "record/schema.hpp"
#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::farm::detail {

namespace {

/// Longer than any transaction of ours, a submission of 100,000 jobs included.
constexpr int kBusyTimeoutMs = 60'000;

[[noreturn]] void fail(sqlite3* db, const std::string& path) {
  const int code = db ? sqlite3_extended_errcode(db) : SQLITE_NOMEM;
  const std::string text = db ? sqlite3_errmsg(db) : "out of memory";
  if ((code & 0xff) == SQLITE_NOTADB || (code & 0xff) == SQLITE_CORRUPT) {
    throw InputError(path, "", fmt::format("{}; expected the database of a farm", text));
  }
  // SQLite says "unable to open" of a full disk, too.
  const int why = db ? sqlite3_system_errno(db) : 0;
  throw DeviceError(fmt::format("{}: {} (code {}){}", path, text, code,
                                why == 0 ? "" : ": " + std::generic_category().message(why)));
}

}  // namespace

Rows::Rows(sqlite3* db, sqlite3_stmt* statement, const std::string& path)
    : db_(db), statement_(statement), path_(path) {}
Rows::~Rows() {
  sqlite3_reset(statement_);
  sqlite3_clear_bindings(statement_);
}
bool Rows::next() {
  const int code = sqlite3_step(statement_);
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  fail(db_, path_);
}
bool Rows::null(int column) const { return sqlite3_column_type(statement_, column) == SQLITE_NULL; }
std::int64_t Rows::integer(int column) const { return sqlite3_column_int64(statement_, column); }
double Rows::number(int column) const { return sqlite3_column_double(statement_, column); }
std::string Rows::text(int column) const {
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
  return text
             ? std::string(text, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column)))
             : std::string();
}

Database::Database(const std::string& path, Mode mode) : path_(path) {
  if (mode == Mode::create && ::access(path.c_str(), F_OK) != 0) {
    // Under another name until it is whole: an empty record is never one that somebody just makes.
    const slicecorr::detail::Temporary part{slicecorr::detail::make_temporary(path)};
    // SQLite removes them when it closes, if it can.
    const slicecorr::detail::Temporary log{part.path + "-wal"}, index{part.path + "-shm"},
        journal{part.path + "-journal"};
    { const Database whole(part.path, Mode::make); }
    // Who else makes one may be faster.
    if (::link(part.path.c_str(), path.c_str()) != 0 && errno != EEXIST) {
      throw DeviceError(slicecorr::detail::errno_message(path, "can't be made"));
    }
    slicecorr::detail::sync_folder(slicecorr::detail::path_parts(path).folder);
  }
  // Readers open for writing too: WAL's shared memory may have to be made. query_only keeps them
  // from changing anything.
  if (sqlite3_open_v2(path.c_str(), &db_, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX, nullptr) !=
      SQLITE_OK) {
    const std::string text = db_ ? sqlite3_errmsg(db_) : "out of memory";
    const int why = db_ ? sqlite3_system_errno(db_) : ENOMEM;
    sqlite3_close(db_);
    if (mode == Mode::read) {
      throw InputError(path, "",
                       text + "; expected the database of a farm (slicefarm submit makes one)");
    }
    throw DeviceError(slicecorr::detail::errno_message(path, text, why));
  }
  try {
    sqlite3_extended_result_codes(db_, 1);
    sqlite3_busy_timeout(db_, kBusyTimeoutMs);
    execute("PRAGMA foreign_keys = ON");
    // Before anything is written to it.
    if (mode != Mode::make && version() == 0) {
      throw InputError(path_, "",
                       "is empty; expected the database of a farm. Its jobs are lost where they "
                       "are in no backup; removed, it makes room for a new farm");
    }
    if (mode != Mode::read) {
      use_wal();
      execute("PRAGMA synchronous = FULL");
    }
    migrate();
    if (mode == Mode::read) execute("PRAGMA query_only = ON");
  } catch (...) {
    for (const auto& [sql, s] : statements_) sqlite3_finalize(s);
    sqlite3_close(db_);
    throw;
  }
}

Database::~Database() {
  for (const auto& [sql, s] : statements_) sqlite3_finalize(s);
  sqlite3_close(db_);
}

void Database::use_wal() {
  // When several open a new or restored database at once, SQLite refuses all but one of them
  // without waiting: each would wait for the others' read locks.
  constexpr int step_ms = 5;
  for (int waited_ms = 0;; waited_ms += step_ms) {
    const int code = sqlite3_exec(db_, "PRAGMA journal_mode = WAL", nullptr, nullptr, nullptr);
    if (code == SQLITE_OK) return;
    if ((code & 0xFF) != SQLITE_BUSY || waited_ms >= kBusyTimeoutMs) fail(db_, path_);
    sqlite3_sleep(step_ms);
  }
}

/// The version of the database; 0: it is empty.
std::int64_t Database::version() {
  const auto pragma = [&](const char* sql) {
    Rows rows = query(sql);
    return rows.next() ? rows.integer(0) : 0;
  };
  const std::int64_t version = pragma("PRAGMA user_version");
  const std::int64_t id = pragma("PRAGMA application_id");
  if (version == 0 && id == 0) return 0;
  if (id != kApplicationId) {
    throw InputError(path_, "", "is a database of another program; expected one of a farm");
  }
  if (version > kSchemaVersion) {
    throw InputError(path_, "",
                     fmt::format("made by a newer version of this program: schema {}, this "
                                 "program knows up to {}",
                                 version, kSchemaVersion));
  }
  return version;
}

void Database::migrate() {
  std::int64_t version = this->version();
  if (version == kSchemaVersion) return;
  Transaction transaction(*this);
  version = this->version();
  if (version == kSchemaVersion) return;  // another process was faster
  if (version < 1) execute(kSchema);
  if (version < 2) execute(kSchemaOfTomography);
  if (version < 3) execute(kSchemaOfTimes);
  if (version < 4) execute(kSchemaOfVerdicts);
  if (version < 5) execute(kSchemaOfScans);
  if (version < 6) execute(kSchemaOfLongQueues);
  if (version < 7) execute(kSchemaOfWords);
  execute(fmt::format("PRAGMA application_id = {}", kApplicationId).c_str());
  execute(fmt::format("PRAGMA user_version = {}", kSchemaVersion).c_str());
  transaction.commit();
}

std::int64_t Database::changes() const { return sqlite3_changes64(db_); }
std::int64_t Database::last_id() const { return sqlite3_last_insert_rowid(db_); }

void Database::execute(const char* sql) {
  if (sqlite3_exec(db_, sql, nullptr, nullptr, nullptr) != SQLITE_OK) fail(db_, path_);
}

sqlite3_stmt* Database::prepare(std::string_view sql) {
  if (const auto known = statements_.find(sql); known != statements_.end()) return known->second;
  sqlite3_stmt* s = nullptr;
  if (sqlite3_prepare_v3(db_, sql.data(), static_cast<int>(sql.size()), SQLITE_PREPARE_PERSISTENT,
                         &s, nullptr) != SQLITE_OK) {
    fail(db_, path_);
  }
  statements_.emplace(std::string(sql), s);
  return s;
}

void Database::bind(sqlite3_stmt* s, int index, std::int64_t value) {
  if (sqlite3_bind_int64(s, index, value) != SQLITE_OK) fail(db_, path_);
}
void Database::bind(sqlite3_stmt* s, int index, double value) {
  if (sqlite3_bind_double(s, index, value) != SQLITE_OK) fail(db_, path_);
}
void Database::bind(sqlite3_stmt* s, int index, const std::optional<double>& value) {
  if (value) return bind(s, index, *value);
  if (sqlite3_bind_null(s, index) != SQLITE_OK) fail(db_, path_);
}
void Database::bind(sqlite3_stmt* s, int index, std::string_view value) {
  if (sqlite3_bind_text(s, index, value.data(), static_cast<int>(value.size()), SQLITE_TRANSIENT) !=
      SQLITE_OK) {
    fail(db_, path_);
  }
}

Transaction::Transaction(Database& db) : db_(db) { db_.execute("BEGIN IMMEDIATE"); }
Transaction::~Transaction() {
  if (!open_) return;
  try {
    db_.execute("ROLLBACK");
  } catch (...) {
    // SQLite has rolled back by itself after some errors, a full disk among them.
  }
}
void Transaction::commit() {
  db_.execute("COMMIT");
  open_ = false;
}

}  // namespace slicecorr::farm::detail
