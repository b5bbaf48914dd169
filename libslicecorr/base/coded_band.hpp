// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The slices of one band, run-length coded: appended one after the other, read in any order.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "base/run_length.hpp"

namespace slicecorr::detail {

/// True when all n bytes are 0.
inline bool all_zero(const std::uint8_t* p, std::size_t n) {
  std::uint64_t any = 0;
  std::size_t i = 0;
  for (; i + 8 <= n && any == 0; i += 8) std::memcpy(&any, p + i, 8);
  if (any) return false;
  for (; i < n; ++i) any |= p[i];
  return any == 0;
}

class CodedBand {
 public:
  explicit CodedBand(std::size_t columns) : columns_(columns) {}

  /// Adds the next slice; null is black. One like that before it takes no more room.
  void append(const std::uint8_t* rows) {
    const std::size_t from = code_.size();
    if (rows && !all_zero(rows, columns_)) run_length_encode(rows, columns_, code_);
    end_slice(from);
  }
  /// Adds a slice like the one before it; black where there is none.
  void append_again() { slices_.push_back(slices_.empty() ? Range{} : slices_.back()); }
  /// Adds a slice of another band of as many columns.
  void append_of(const CodedBand& other, int slice) {
    const std::size_t from = code_.size();
    code_.insert(code_.end(), other.begin_of(slice), other.end_of(slice));
    end_slice(from);
  }
  /// Gives back memory that no slice needs.
  void trim() {
    code_.shrink_to_fit();
    slices_.shrink_to_fit();
  }
  std::size_t bytes() const { return code_.capacity() + slices_.capacity() * sizeof(Range); }
  int slices() const { return static_cast<int>(slices_.size()); }
  /// True for slices that there are none of, too.
  bool black(int slice) const {
    return slice < 0 || slice >= slices() || range(slice).first == range(slice).past;
  }
  /// Whether two slices are alike; both must be there.
  bool same(int slice, int other) const {
    return range(slice) == range(other) ||
           std::equal(begin_of(slice), end_of(slice), begin_of(other), end_of(other));
  }
  /// Writes a slice to `out`; black outside the columns that are coded.
  void read(int slice, std::uint8_t* out) const {
    if (black(slice)) {
      std::fill_n(out, columns_, std::uint8_t{0});
      return;
    }
    run_length_decode(begin_of(slice), end_of(slice), out, columns_);
  }
  /// The same without its zeros, in order of the columns, in place of what `out` held.
  void read_nonzero(int slice, std::vector<NonZero>& out) const {
    out.clear();
    if (black(slice)) return;
    run_length_nonzero(begin_of(slice), end_of(slice), columns_, out);
  }
  std::size_t columns() const { return columns_; }
  bool operator==(const CodedBand&) const = default;

 private:
  struct Range {
    std::size_t first = 0, past = 0;
    bool operator==(const Range&) const = default;
  };
  const Range& range(int slice) const { return slices_[static_cast<std::size_t>(slice)]; }
  const std::uint8_t* begin_of(int slice) const { return code_.data() + range(slice).first; }
  const std::uint8_t* end_of(int slice) const { return code_.data() + range(slice).past; }
  void end_slice(std::size_t from) {
    slices_.push_back({from, code_.size()});
    const int last = slices() - 1;
    if (last == 0 || !same(last, last - 1)) return;
    code_.resize(from);
    slices_.back() = range(last - 1);
  }

  std::size_t columns_;
  std::vector<std::uint8_t> code_;
  std::vector<Range> slices_;
};

}  // namespace slicecorr::detail
