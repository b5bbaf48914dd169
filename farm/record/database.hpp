// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file database.hpp
/// A thin layer over SQLite: prepared statements kept by their text, transactions, errors as
/// exceptions. An object belongs to one thread at a time.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

struct sqlite3;
struct sqlite3_stmt;

namespace slicecorr::farm::detail {

/// A statement while it runs; reset when it goes out of scope.
class Rows {
 public:
  Rows(sqlite3* db, sqlite3_stmt* statement, const std::string& path);
  ~Rows();
  Rows(const Rows&) = delete;
  Rows& operator=(const Rows&) = delete;
  /// The next row; false at the end.
  bool next();
  bool null(int column) const;
  std::int64_t integer(int column) const;
  double number(int column) const;
  std::string text(int column) const;
  /// Of the database, for messages.
  const std::string& path() const { return path_; }

 private:
  sqlite3* db_;
  sqlite3_stmt* statement_;
  const std::string& path_;
};

class Database {
 public:
  enum class Mode { create, read, make };
  /// `create`: opens it, or makes it where there is none, with the present schema, WAL, synced at
  /// every commit. `read`: an existing one, read-only. `make`: makes one of an empty file. Throws
  /// `InputError` where it is none, an empty file included, or of a newer program; `DeviceError`
  /// else.
  Database(const std::string& path, Mode mode);
  ~Database();
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  /// Prepares (once per text), binds the values in order to ?1, ?2 ..., and runs.
  template <typename... Values>
  Rows query(std::string_view sql, const Values&... values) {
    sqlite3_stmt* s = prepare(sql);
    int index = 0;
    (bind(s, ++index, values), ...);
    return Rows(db_, s, path_);
  }
  /// The same with any number of texts.
  Rows query_list(std::string_view sql, const std::vector<std::string>& values) {
    sqlite3_stmt* s = prepare(sql);
    int index = 0;
    for (const std::string& value : values) bind(s, ++index, value);
    return Rows(db_, s, path_);
  }
  /// Runs a statement that gives no rows; gives the number of rows changed.
  template <typename... Values>
  std::int64_t run(std::string_view sql, const Values&... values) {
    {
      Rows rows = query(sql, values...);
      while (rows.next()) {
      }
    }
    return changes();
  }
  std::int64_t changes() const;
  std::int64_t last_id() const;
  void execute(const char* sql);
  const std::string& path() const { return path_; }

 private:
  sqlite3_stmt* prepare(std::string_view sql);
  void bind(sqlite3_stmt* s, int index, std::int64_t value);
  void bind(sqlite3_stmt* s, int index, int value) { bind(s, index, std::int64_t{value}); }
  void bind(sqlite3_stmt* s, int index, bool value) { bind(s, index, std::int64_t{value}); }
  void bind(sqlite3_stmt* s, int index, double value);
  void bind(sqlite3_stmt* s, int index, const std::optional<double>& value);  ///< nothing: NULL
  void bind(sqlite3_stmt* s, int index, std::string_view value);
  void bind(sqlite3_stmt* s, int index, const std::string& value) {
    bind(s, index, std::string_view(value));
  }
  void bind(sqlite3_stmt* s, int index, const char* value) {
    bind(s, index, std::string_view(value));
  }
  void use_wal();
  std::int64_t version();
  void migrate();

  std::string path_;
  sqlite3* db_ = nullptr;
  std::map<std::string, sqlite3_stmt*, std::less<>> statements_;
};

/// A write transaction from the start (BEGIN IMMEDIATE): rolled back unless committed.
class Transaction {
 public:
  explicit Transaction(Database& db);
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit();

 private:
  Database& db_;
  bool open_ = true;
};

}  // namespace slicecorr::farm::detail
