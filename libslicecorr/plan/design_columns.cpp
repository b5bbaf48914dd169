// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "plan/design_columns.hpp"

#include <algorithm>
#include <cstring>
#include <mutex>
#include <tuple>
#include <unordered_map>

#include "pipeline/vanished.hpp"

namespace slicecorr::detail {

namespace {

/// What is known of the pixels that share a column.
struct Seen {
  int x = 0, y = 0;
  std::uint64_t pixels = 0;
  void add(int its_x, int its_y, std::uint64_t its_pixels) {
    if (pixels == 0 || std::tie(its_y, its_x) < std::tie(y, x)) {
      x = its_x;
      y = its_y;
    }
    pixels += its_pixels;
  }
};
/// By the bytes of a column's events.
using SeenColumns = std::unordered_map<std::string, Seen>;

void append(std::string& key, const ColumnEvent& e) {
  char bytes[6];
  std::memcpy(bytes, &e.layer, 4);
  bytes[4] = static_cast<char>(e.coverage);
  bytes[5] = static_cast<char>(e.height);
  key.append(bytes, sizeof bytes);
}

SeenColumns columns_of_band(const SliceSource& target, const PixelBox& band,
                            const ExecutionContext& context) {
  const std::size_t count = columns_of(band);
  std::vector<std::string> keys(count);
  std::vector<std::uint8_t> before(count, 0), empty(count, 0), full(count, 0);
  const auto heights = edge_heights_of(target, band);
  const auto take = [&](int n, const std::uint8_t* rows, const std::uint8_t* its_heights) {
    if ((n & 63) == 0) context.check_cancelled();
    const std::uint8_t* const now = rows ? rows : empty.data();
    constexpr std::size_t kBlock = 64;
    for (std::size_t b = 0; b < count; b += kBlock) {
      const std::size_t some = std::min(kBlock, count - b);
      const bool none = !its_heights || all_zero(its_heights + b, some);
      if (none && std::memcmp(now + b, before.data() + b, some) == 0) continue;
      for (std::size_t i = b; i < b + some; ++i) {
        const std::uint8_t height = its_heights ? its_heights[i] : std::uint8_t{0};
        if (now[i] == before[i] && height == 0) continue;
        append(keys[i], {n, now[i], height});
        before[i] = now[i];
        full[i] |= static_cast<std::uint8_t>(now[i] == 255);
      }
    }
  };
  read_design(reader_of(target, band), heights ? &*heights : nullptr, Surface::mesh, take);
  SeenColumns seen;
  const auto width = static_cast<std::size_t>(band.width());
  for (std::size_t i = 0; i < count; ++i) {
    if (!full[i]) continue;
    seen[std::move(keys[i])].add(band.x0 + static_cast<int>(i % width),
                                 band.y0 + static_cast<int>(i / width), 1);
  }
  return seen;
}

}  // namespace

DesignColumns::DesignColumns(const SliceSource& target, const ExecutionContext& context)
    : layers_(target.grid().layers), has_heights_(target.edge_heights() != nullptr) {
  const auto bands = bands_of(target.grid(), target.bounds());
  SeenColumns all;
  std::mutex merging;
  parallel_for(context, "columns", bands.size(), [&](std::size_t i) {
    SeenColumns seen = columns_of_band(target, bands[i], context);
    const std::lock_guard lock(merging);
    while (!seen.empty()) {
      auto node = seen.extract(seen.begin());
      all[std::move(node.key())].add(node.mapped().x, node.mapped().y, node.mapped().pixels);
    }
  });
  if (all.empty()) refuse_vanished(target);
  std::vector<std::pair<const std::string*, Seen>> sorted;
  sorted.reserve(all.size());
  std::size_t events = 0;
  for (const auto& [key, seen] : all) {
    sorted.emplace_back(&key, seen);
    events += key.size() / 6;
  }
  std::sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) {
    return std::tie(a.second.y, a.second.x) < std::tie(b.second.y, b.second.x);
  });
  columns_.reserve(sorted.size());
  events_.reserve(events);
  for (const auto& [key, seen] : sorted) {
    columns_.push_back({seen.x, seen.y, seen.pixels, events_.size(), key->size() / 6});
    pixels_ += seen.pixels;
    for (std::size_t at = 0; at < key->size(); at += 6) {
      ColumnEvent e{};
      std::memcpy(&e.layer, key->data() + at, 4);
      e.coverage = static_cast<std::uint8_t>((*key)[at + 4]);
      e.height = static_cast<std::uint8_t>((*key)[at + 5]);
      events_.push_back(e);
    }
  }
}

DesignReader DesignColumns::reader(std::span<const std::uint32_t> which) const {
  return [this, which](const DesignSink& sink) {
    const std::size_t count = which.size();
    std::vector<std::span<const ColumnEvent>> left;
    std::vector<std::int32_t> next(count, layers_ + 1);
    for (std::size_t i = 0; i < count; ++i) {
      left.push_back(events(which[i]));
      if (!left[i].empty()) next[i] = left[i].front().layer;
    }
    std::vector<std::uint8_t> rows(count, 0), heights(count, 0);
    const int past = layers_ + (has_heights_ ? 1 : 0);
    for (int n = 0; n < past; ++n) {
      bool any = false;
      for (std::size_t i = 0; i < count; ++i) {
        heights[i] = 0;
        if (next[i] != n) continue;
        const ColumnEvent& e = left[i].front();
        rows[i] = e.coverage;
        heights[i] = e.height;
        any = any || e.height != 0;
        left[i] = left[i].subspan(1);
        next[i] = left[i].empty() ? layers_ + 1 : left[i].front().layer;
      }
      sink(n, n < layers_ ? rows.data() : nullptr, any ? heights.data() : nullptr);
    }
  };
}

}  // namespace slicecorr::detail
