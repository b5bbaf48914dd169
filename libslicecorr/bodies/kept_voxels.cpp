// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bodies/kept_voxels.hpp"

#include <algorithm>
#include <bit>
#include <filesystem>
#include <iterator>
#include <limits>
#include <utility>

#include "base/byte_bits.hpp"
#include "bodies/body_listeners.hpp"
#include "bodies/solid_strips.hpp"
#include "bodies/timed_rows.hpp"
#include "parallel/silent.hpp"
#include "support/numbers/release.hpp"

namespace slicecorr::detail {

namespace {

constexpr std::size_t kMemory = std::size_t{16} << 20;
/// Codes are kept in pieces of about this size, which end where a slice does.
constexpr std::size_t kPiece = std::size_t{4} << 10;

/// So many slices of a strip are followed before those of others must have been, too.
constexpr int kSlicesAtOnce = 32;
constexpr std::size_t kMostStrips = 16;

/// Bytes of a number at most.
constexpr std::size_t kNumberBytes = 10;

std::uint8_t* put_number(std::uint8_t* to, std::uint64_t value) {
  for (; value >= 128; value >>= 7) *to++ = static_cast<std::uint8_t>(value | 128);
  *to++ = static_cast<std::uint8_t>(value);
  return to;
}
void put_number(std::vector<std::uint8_t>& code, std::uint64_t value) {
  std::uint8_t bytes[kNumberBytes];
  code.insert(code.end(), bytes, put_number(bytes, value));
}

std::uint64_t take_number(const std::uint8_t*& at) {
  std::uint64_t value = 0;
  int shift = 0;
  for (; *at & 128; shift += 7) value |= static_cast<std::uint64_t>(*at++ & 127) << shift;
  return value | static_cast<std::uint64_t>(*at++) << shift;
}

/// Puts places in the order of a key, equal ones in the order that they had.
template <class Place, class Key>
void sort_by(std::vector<Place>& places, const Key& key) {
  std::uint32_t last = 0;
  for (const Place& p : places) last = std::max(last, key(p));
  std::vector<std::uint32_t> next(std::size_t{last} + 2, 0);
  for (const Place& p : places) ++next[key(p) + 1];
  for (std::size_t n = 1; n < next.size(); ++n) next[n] += next[n - 1];
  std::vector<Place> sorted(places.size());
  for (const Place& p : places) sorted[next[key(p)]++] = p;
  places = std::move(sorted);
}

template <class Place>
void sort_by_slice(std::vector<Place>& places) {
  sort_by(places, [](const Place& p) { return p.slice(); });
}

/// By slice, then by column.
template <class Place>
void sort_places(std::vector<Place>& places) {
  sort_by(places, [](const Place& p) { return p.column; });
  sort_by_slice(places);
}

/// The same where those of a slice come from the first column to the last, most often.
template <class Place>
void sort_told(std::vector<Place>& places) {
  sort_by_slice(places);
  const auto back = [](const Place& a, const Place& b) {
    return a.slice() == b.slice() && b.column < a.column;
  };
  if (std::ranges::adjacent_find(places, back) != places.end()) sort_places(places);
}

/// Puts what changes in a slice, from the first column to the last: groups of neighbouring columns with the
/// same value. `room` is for this alone.
template <bool valued, class Place>
void put_groups(std::vector<std::uint8_t>& code, std::span<const Place> places,
                std::vector<std::uint8_t>& room) {
  const auto goes_on = [&](std::size_t i) {
    if constexpr (valued) {
      if (places[i].value() != places[i - 1].value()) return false;
    }
    return places[i].column == places[i - 1].column + 1;
  };
  std::size_t groups = places.empty() ? 0 : 1;
  for (std::size_t i = 1; i < places.size(); ++i) groups += goes_on(i) ? 0 : 1;
  room.resize(std::max(room.size(), (1 + 3 * groups) * kNumberBytes));
  std::uint8_t* to = put_number(room.data(), groups);
  std::uint32_t column = 0;
  for (std::size_t i = 0, past = 0; i < places.size(); i = past) {
    for (past = i + 1; past < places.size() && goes_on(past);) ++past;
    const std::size_t length = past - i;
    to = put_number(to, std::uint64_t{2} * (places[i].column - column) + (length > 1 ? 1 : 0));
    if (length > 1) to = put_number(to, length - 2);
    if constexpr (valued) to = put_number(to, places[i].value());
    column = places[past - 1].column + 1;
  }
  code.insert(code.end(), room.data(), to);
}

std::string folder_of_kept() {
  std::error_code none;
  const std::filesystem::path folder = std::filesystem::temp_directory_path(none);
  return none ? std::string() : folder.string();
}

}  // namespace

void VoxelChanges::add_slice(int slice, const std::uint8_t* rows) {
  if (!rows && before_.empty()) return;
  before_.resize((columns_ + 63) / 64, 0);
  for (std::size_t w = 0; w < before_.size(); ++w) {
    std::uint64_t bits = 0;
    if (rows && 64 * w + 64 <= columns_) {
      bits = high_bits(rows + 64 * w);
    } else if (rows) {
      std::uint8_t tail[64] = {};
      std::copy(rows + 64 * w, rows + columns_, tail);
      bits = high_bits(tail);
    }
    for (std::uint64_t changed = bits ^ before_[w]; changed; changed &= changed - 1) {
      flip(slice, 64 * w + static_cast<std::size_t>(std::countr_zero(changed)));
    }
    before_[w] = bits;
  }
}

void VoxelChanges::sort() {
  if (std::exchange(sorted_, true) || flips_.empty()) return;
  sort_places(flips_);
  kinds_ = 0;
  std::size_t kept = 0;
  for (std::size_t at = 0; at < flips_.size();) {
    const Flip one = flips_[at++];
    unsigned kinds = one.kinds();
    for (; at < flips_.size() && flips_[at].same_place(one); ++at) kinds ^= flips_[at].kinds();
    if (kinds == 0) continue;
    kinds_ |= kinds;
    flips_[kept++] = {one.slice() << kKinds | kinds, one.column};
  }
  flips_.resize(kept);
}

std::vector<std::uint8_t> VoxelChanges::code(int layers, unsigned kind) {
  sort();
  std::vector<std::uint8_t> code, room;
  if ((kinds_ & kind) == 0) return code;
  std::vector<Flip> its;
  std::size_t last = 0;  // slice
  for (auto at = flips_.begin(); at != flips_.end();) {
    const std::size_t n = at->slice();
    if (n >= static_cast<std::size_t>(layers)) break;
    its.clear();
    for (; at != flips_.end() && at->slice() == n; ++at) {
      if ((at->kinds() & kind) != 0) its.push_back(*at);
    }
    if (its.empty()) continue;
    put_number(code, n - last);
    put_groups<false, Flip>(code, its, room);
    last = n;
  }
  return code;
}

std::vector<std::uint8_t> MomentChanges::code(int layers, int from) {
  std::vector<std::uint8_t> code, room;
  const auto is_later = [&](const Change& c) { return static_cast<int>(c.slice()) >= from; };
  std::vector<Change> coded;
  std::ranges::copy_if(changes_, std::back_inserter(coded), is_later);
  std::erase_if(changes_, is_later);
  most_ = std::max(kMany, 2 * changes_.size());
  if (coded.empty()) return code;
  sort_told(coded);
  std::size_t last = 0;  // slice
  for (auto at = coded.begin(), past = at; at != coded.end(); at = past) {
    const std::size_t n = at->slice();
    if (n >= static_cast<std::size_t>(layers)) break;
    for (past = at; past != coded.end() && past->slice() == n;) ++past;
    // What begins anew says so.
    if (code.empty()) put_number(code, 0);
    put_number(code, n - last);
    put_groups<true, Change>(code, {at, past}, room);
    last = n;
  }
  return code;
}

/// Reads a band's changes slice by slice.
class KeptVoxels::Reader {
 public:
  static constexpr int kNoSlice = std::numeric_limits<int>::max();

  /// `valued`: these are moments.
  Reader(const KeptVoxels& kept, const Pieces& pieces, const PixelBox& box, bool valued)
      : kept_(kept), blobs_(pieces), box_(box), valued_(valued) {
    go_on();
  }
  /// The slice whose changes come next, or kNoSlice.
  int slice() const { return slice_; }
  /// Tells these: to `BodyTracker`, or as it is told.
  template <class Tracker>
  void tell(Tracker& tracker) {
    const std::uint8_t* at = piece_.data() + at_;
    std::uint64_t column = 0;
    const auto width = static_cast<std::uint64_t>(box_.width());
    std::uint64_t row_begin = 0, row_end = 0;
    int y = box_.y0;
    runs_.clear();
    const auto flush = [&] {
      if (!runs_.empty() && valued_) tracker.set_delays(y, runs_);
      if (!runs_.empty() && !valued_) tracker.flip_row(y, runs_);
      runs_.clear();
    };
    for (std::uint64_t groups = take_number(at); groups-- > 0;) {
      const std::uint64_t head = take_number(at);
      column += head / 2;
      std::uint64_t length = head % 2 == 1 ? take_number(at) + 2 : 1;
      const std::uint64_t value = valued_ ? take_number(at) : 0;
      while (length > 0) {
        if (column >= row_end) {
          flush();
          const std::uint64_t row = column / width;
          y = box_.y0 + static_cast<int>(row);
          row_begin = row * width;
          row_end = row_begin + width;
        }
        const std::uint64_t part = std::min(length, row_end - column);
        const int begin = box_.x0 + static_cast<int>(column - row_begin);
        runs_.push_back(
            {begin, begin + static_cast<int>(part), static_cast<int>(value / 2), value % 2 == 1});
        column += part;
        length -= part;
      }
    }
    flush();
    at_ = static_cast<std::size_t>(at - piece_.data());
    go_on();
  }

 private:
  void go_on() {
    while (at_ == piece_.size()) {
      if (next_ == blobs_.size()) {
        slice_ = kNoSlice;
        release(piece_);
        return;
      }
      piece_.clear();
      at_ = 0;
      kept_.store_.get(blobs_[next_++], piece_);
    }
    const std::uint8_t* at = piece_.data() + at_;
    std::uint64_t further = take_number(at);
    if (valued_ && further == 0) {
      slice_ = 0;
      further = take_number(at);
    }
    slice_ += static_cast<int>(further);
    at_ = static_cast<std::size_t>(at - piece_.data());
  }
  const KeptVoxels& kept_;
  const Pieces& blobs_;
  const PixelBox box_;
  const bool valued_;
  std::size_t next_ = 0, at_ = 0;
  std::vector<std::uint8_t> piece_;
  int slice_ = 0;
  std::vector<BodyTracker::Run> runs_;
};

KeptVoxels::KeptVoxels(std::vector<PixelBox> bands, int layers, const ExecutionContext& context)
    : bands_(std::move(bands)),
      layers_(layers),
      context_(context),
      store_(folder_of_kept(), kMemory, context) {}

KeptVoxels::Pieces KeptVoxels::keep(const std::vector<std::uint8_t>& code, bool valued) {
  Pieces pieces;
  const std::uint8_t *from = code.data(), *const end = from + code.size();
  for (const std::uint8_t* at = from; at != end;) {
    if (take_number(at) == 0 && valued) take_number(at);
    for (std::uint64_t groups = take_number(at); groups-- > 0;) {
      if (take_number(at) % 2 == 1) take_number(at);
      if (valued) take_number(at);
    }
    if (at != end && static_cast<std::size_t>(at - from) < kPiece) continue;
    pieces.push_back(store_.put(from, static_cast<std::size_t>(at - from)));
    from = at;
  }
  return pieces;
}

/// Reads what some bands hold, slice by slice.
class KeptVoxels::SliceReader {
 public:
  SliceReader(const KeptVoxels& kept, const Followed& what, std::size_t first, std::size_t past) {
    for (std::size_t i = first; i < past; ++i) {
      const auto read = [&](const Stream& stream, bool valued) {
        if (!stream[i].empty()) readers_.emplace_back(kept, stream[i], kept.bands_[i], valued);
      };
      read(what.changes, false);
      if (what.more) read(*what.more, false);
      if (what.moments) read(*what.moments, true);
    }
  }
  /// Tells the slices before `past`; `end(more)` ends one, and `more` after it that are like it.
  template <class Tracker, class End>
  void read_until(int past, Tracker& tracker, const End& end) {
    for (;;) {
      int next = Reader::kNoSlice;
      for (const Reader& r : readers_) next = std::min(next, r.slice());
      const int stop = std::min(next, past);
      if (stop > at_hand_) end(stop - at_hand_ - 1);
      at_hand_ = std::max(at_hand_, stop);
      if (next >= past) return;
      for (Reader& r : readers_) {
        if (r.slice() == next) r.tell(tracker);
      }
    }
  }

 private:
  int at_hand_ = 0;
  std::vector<Reader> readers_;
};

Bodies KeptVoxels::follow(const Followed& what, const Grid& grid, const ImageFrame& frame,
                          const BodyAsk& ask) const {
  PixelBox box;
  for (const PixelBox& band : bands_) box = box.united(band);
  // What is not solid, and necks: slice by slice, beside what is.
  BodyAsk asked = ask;
  asked.solids = false;
  BodyTracker tracker(box, grid, frame, asked);
  const bool any = layers_ > 0 && !box.empty();
  const bool others = ask.voids || ask.least_neck_mm2 > 0;
  SolidListener listener(Origin{box.x0, box.y0}, ask.time_step);
  parallel_for(silent(context_), "", any ? 2 : 0, [&](std::size_t i) {
    if (i == 0) {
      follow_solids(what, box, ask.time_step, listener);
    } else if (others) {
      SliceReader reader(*this, {what.changes, what.more}, 0, bands_.size());
      for (int past = 0; past < layers_;) {
        context_.check_cancelled();
        past = std::min(past + kSlicesAtOnce, layers_);
        reader.read_until(past, tracker, [&](int more) { tracker.end_slice(more); });
      }
    }
  });
  Bodies found = tracker.finish();
  listener.put(found);
  for (Island& island : found.islands) {
    island.x += box.x0;
    island.y += box.y0;
  }
  return found;
}

void KeptVoxels::follow_solids(const Followed& what, const PixelBox& box, int step,
                               SolidListener& listener) const {
  // Strips of whole bands, from the top down.
  const std::size_t each = (bands_.size() + kMostStrips - 1) / kMostStrips;
  std::vector<int> ends;
  std::vector<TimedRows> rows;
  std::vector<SliceReader> readers;
  for (std::size_t first = 0; first < bands_.size(); first += each) {
    const std::size_t past = std::min(first + each, bands_.size());
    ends.push_back(bands_[past - 1].y1 - box.y0);
    rows.emplace_back(PixelBox{box.x0, bands_[first].y0, box.x1, bands_[past - 1].y1}, false);
    readers.emplace_back(*this, what, first, past);
  }
  SolidStrips strips(ends, step, listener);
  for (int past = 0; past < layers_;) {
    past = std::min(past + kSlicesAtOnce, layers_);
    parallel_for(silent(context_), "", strips.size(), [&](std::size_t i) {
      SolidRows& strip = strips.strip(i);
      readers[i].read_until(past, rows[i], [&](int more) {
        rows[i].end_slice(more, [&](int row, std::span<const SolidRows::Change> changes, bool) {
          strip.change_row(row, changes);
        });
        strip.end_slice(more);
      });
      strip.make_room();
    });
    strips.pass(past);
  }
  if (step > 1) listener.set_slices(layers_);
  strips.finish();
}

}  // namespace slicecorr::detail
