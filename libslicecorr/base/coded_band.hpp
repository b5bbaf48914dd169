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

  /// Adds the next slice; null is black.
  void append(const std::uint8_t* rows) {
    if (rows && !all_zero(rows, columns_)) run_length_encode(rows, columns_, code_);
    ends_.push_back(code_.size());
  }
  /// Adds a slice like the one before it; black where there is none.
  void append_again() {
    if (!ends_.empty()) {
      const std::size_t from = begin(slices() - 1), to = ends_.back();
      code_.resize(to + (to - from));
      std::copy_n(code_.data() + from, to - from, code_.data() + to);
    }
    ends_.push_back(code_.size());
  }
  /// Adds a slice of another band of as many columns.
  void append_of(const CodedBand& other, int slice) {
    code_.insert(code_.end(), other.code_.data() + other.begin(slice),
                 other.code_.data() + other.ends_[static_cast<std::size_t>(slice)]);
    ends_.push_back(code_.size());
  }
  /// Gives back memory that no slice needs.
  void trim() {
    code_.shrink_to_fit();
    ends_.shrink_to_fit();
  }
  std::size_t bytes() const { return code_.capacity() + ends_.capacity() * sizeof(std::size_t); }
  /// Whether two slices are alike.
  bool same(int slice, int other) const {
    const std::uint8_t *a = code_.data() + begin(slice), *b = code_.data() + begin(other);
    return std::equal(a, code_.data() + ends_[static_cast<std::size_t>(slice)], b,
                      code_.data() + ends_[static_cast<std::size_t>(other)]);
  }
  int slices() const { return static_cast<int>(ends_.size()); }
  bool black(int slice) const { return begin(slice) == ends_[static_cast<std::size_t>(slice)]; }
  /// Writes a slice to `out`; black outside the columns that are coded.
  void read(int slice, std::uint8_t* out) const {
    if (slice < 0 || slice >= slices() || black(slice)) {
      std::memset(out, 0, columns_);
      return;
    }
    run_length_decode(code_.data() + begin(slice),
                      code_.data() + ends_[static_cast<std::size_t>(slice)], out, columns_);
  }
  /// The same without its zeros, in order of the columns, in place of what `out` held.
  void read_nonzero(int slice, std::vector<NonZero>& out) const {
    out.clear();
    if (slice < 0 || slice >= slices() || black(slice)) return;
    run_length_nonzero(code_.data() + begin(slice),
                       code_.data() + ends_[static_cast<std::size_t>(slice)], columns_, out);
  }
  std::size_t columns() const { return columns_; }

 private:
  std::size_t begin(int slice) const {
    return slice ? ends_[static_cast<std::size_t>(slice) - 1] : 0;
  }
  std::size_t columns_;
  std::vector<std::uint8_t> code_;
  std::vector<std::size_t> ends_;
};

}  // namespace slicecorr::detail
