// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/solved_columns.hpp"

#include <atomic>
#include <functional>
#include <utility>

namespace slicecorr::detail {

namespace {

/// Of all that live: a stack may have a plan for each brightness of its window.
std::atomic<std::size_t> kept_bytes{0};

/// A place in the map, two strings and what the allocator adds.
std::size_t bytes_of(const std::string& key, const std::string& value) {
  constexpr std::size_t around = 144;
  return around + key.size() + value.size();
}

}  // namespace

SolvedColumns::~SolvedColumns() {
  for (const Shelf& shelf : shelves_) kept_bytes -= shelf.lately_bytes + shelf.before_bytes;
}

SolvedColumns::Shelf& SolvedColumns::shelf_of(const std::string& key) {
  return shelves_[std::hash<std::string>{}(key) / 64 % shelves_.size()];
}

bool SolvedColumns::find(const std::string& key, std::string& value) {
  Shelf& shelf = shelf_of(key);
  const std::lock_guard guard(shelf.lock);
  if (const auto found = shelf.lately.find(key); found != shelf.lately.end()) {
    value = found->second;
    return true;
  }
  const auto found = shelf.before.find(key);
  if (found == shelf.before.end()) return false;
  value = found->second;
  const std::size_t bytes = bytes_of(key, value);
  shelf.before_bytes -= bytes;
  kept_bytes -= bytes;
  auto node = shelf.before.extract(found);
  add(shelf, key, std::move(node.mapped()));
  return true;
}

void SolvedColumns::keep(const std::string& key, const std::string& value) {
  Shelf& shelf = shelf_of(key);
  const std::lock_guard guard(shelf.lock);
  // Another thread may have solved it meanwhile.
  if (shelf.lately.contains(key) || shelf.before.contains(key)) return;
  add(shelf, key, value);
}

void SolvedColumns::add(Shelf& shelf, const std::string& key, std::string value) {
  const std::size_t bytes = bytes_of(key, value);
  // What was asked for lately grows to half of this shelf's share.
  if (shelf.lately_bytes + bytes > most_bytes_ / shelves_.size() / 2) forget_before(shelf);
  if (kept_bytes + bytes > most_bytes_) return;
  shelf.lately.emplace(key, std::move(value));
  shelf.lately_bytes += bytes;
  kept_bytes += bytes;
}

void SolvedColumns::forget_before(Shelf& shelf) {
  kept_bytes -= shelf.before_bytes;
  shelf.before = std::exchange(shelf.lately, {});
  shelf.before_bytes = std::exchange(shelf.lately_bytes, 0);
}

}  // namespace slicecorr::detail
