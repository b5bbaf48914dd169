// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/flow_part.hpp"

#include <algorithm>
#include <string_view>
#include <unordered_map>

#include "base/coded_band.hpp"
#include "flow/coarse_slices.hpp"
#include "flow/voids.hpp"

namespace slicecorr {

namespace {

/// A mask as bytes: kinds of cells, coverage, and the voids of blind cells, low bytes first, named in
/// the order in which cells have them, so that masks that are alike have the same bytes.
class MaskBytes {
 public:
  explicit MaskBytes(std::size_t cells) : cells_(cells), bytes_(4 * cells) {}

  void set(const detail::SliceCells& slice, const std::vector<std::uint8_t>& coverage) {
    names_.clear();
    for (std::size_t k = 0; k < cells_; ++k) {
      bytes_[k] = static_cast<std::uint8_t>(slice.kinds[k]);
      bytes_[cells_ + k] = coverage[k];
      unsigned name = 0;
      if (slice.voids[k] >= 0) {
        name =
            names_.try_emplace(slice.voids[k], static_cast<unsigned>(names_.size())).first->second;
      }
      bytes_[2 * cells_ + k] = static_cast<std::uint8_t>(name & 255U);
      bytes_[3 * cells_ + k] = static_cast<std::uint8_t>(name >> 8U);
    }
  }
  const std::vector<std::uint8_t>& bytes() const { return bytes_; }

  static void to_section(const std::vector<std::uint8_t>& bytes, FlowSection& section) {
    const std::size_t cells = section.size();
    section.cells.resize(cells);
    section.coverage.resize(cells);
    section.voids.assign(cells, 0);
    for (std::size_t k = 0; k < cells; ++k) {
      section.cells[k] = static_cast<FlowCell>(bytes[k]);
      section.coverage[k] = static_cast<float>(bytes[cells + k]) / 255.0F;
      section.voids[k] = bytes[2 * cells + k] | bytes[3 * cells + k] << 8;
    }
  }

 private:
  std::size_t cells_;
  std::vector<std::uint8_t> bytes_;
  std::unordered_map<int, unsigned> names_;
};

/// Masks by what they are; each is kept once.
class MaskStore {
 public:
  explicit MaskStore(std::size_t bytes) : coded_(bytes), decoded_(bytes) {}
  /// The number of a mask; one more than there were when it is new.
  int number_of(const std::vector<std::uint8_t>& bytes) {
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    std::vector<int>& alike = by_hash_[std::hash<std::string_view>()(text)];
    for (const int one : alike) {
      coded_.read(one, decoded_.data());
      if (decoded_ == bytes) return one;
    }
    alike.push_back(coded_.slices());
    coded_.append(bytes.data());
    return alike.back();
  }
  detail::CodedBand take() {
    coded_.trim();
    return std::move(coded_);
  }

 private:
  detail::CodedBand coded_;
  std::vector<std::uint8_t> decoded_;
  std::unordered_map<std::size_t, std::vector<int>> by_hash_;
};

/// Share of the cells within the outline towards the bath: what is covered in this slice and has
/// gelled material above. Voids are within it, and so is what of a cell belongs to them.
void outline_shares(const FlowGrid& grid, const detail::SliceCells& slice,
                    const std::vector<std::uint8_t>& above, std::vector<std::uint8_t>& shares) {
  const auto columns = static_cast<std::size_t>(grid.columns);
  for (std::size_t k = 0; k < shares.size(); ++k) {
    if (slice.kinds[k] == FlowCell::blind) {
      shares[k] = 255;
      continue;
    }
    if (!above.empty()) shares[k] = std::min(shares[k], above[k]);
    if (slice.kinds[k] == FlowCell::bath || shares[k] == 255) continue;
    // Cells of part are within the ring, and have all eight neighbours.
    bool bath = false, blind = false;
    for (const std::size_t row : {k - columns, k, k + columns}) {
      for (const std::size_t one : {row - 1, row, row + 1}) {
        bath |= slice.kinds[one] == FlowCell::bath;
        blind |= slice.kinds[one] == FlowCell::blind;
      }
    }
    if (blind && !bath) shares[k] = 255;
  }
}

}  // namespace

struct FlowPart::Impl {
  FlowGrid grid;
  double layer_um = 0;
  detail::CodedBand masks{0};  ///< MaskBytes, one after the other
  std::vector<int> mask_of, first_slice_of;
  std::vector<BlindVoid> blind;

  void walk(const detail::CoarseSlices& slices, int count, const ExecutionContext& context);
};

void FlowPart::Impl::walk(const detail::CoarseSlices& slices, int count,
                          const ExecutionContext& context) {
  detail::Voids voids(grid, layer_um);
  MaskBytes bytes(grid.cells());
  MaskStore store(bytes.bytes().size());
  std::vector<std::uint8_t> coverage, above, shares;
  detail::SliceCells cells;
  bool again_before = false;
  for (int n = 0; n < count; ++n) {
    if ((n & 15) == 0) {
      context.check_cancelled();
      context.report("follow voids", static_cast<double>(n) / count);
    }
    const bool again = slices.as_before(n);
    if (again) {
      voids.add_again(cells);
    } else {
      above.swap(coverage);
      slices.read(n, coverage);
      voids.add_slice(coverage, cells);
    }
    if (again && again_before) {
      mask_of.push_back(mask_of.back());
      continue;
    }
    again_before = again;
    int mask = -1;
    if (std::find(cells.kinds.begin(), cells.kinds.end(), FlowCell::part) != cells.kinds.end()) {
      shares = coverage;
      outline_shares(grid, cells, again ? coverage : above, shares);
      bytes.set(cells, shares);
      mask = store.number_of(bytes.bytes());
    }
    if (mask == static_cast<int>(first_slice_of.size())) first_slice_of.push_back(n);
    mask_of.push_back(mask);
  }
  context.report("follow voids", 1);
  masks = store.take();
  blind = voids.blind();
}

FlowPart::FlowPart(const SliceSource& source, const FlowPartOptions& options,
                   const ExecutionContext& context)
    : impl_(std::make_unique<Impl>()) {
  impl_->grid = detail::flow_grid(source, options);
  impl_->layer_um = source.grid().layer_um;
  const detail::CoarseSlices slices(source, impl_->grid, options.pixels, context);
  impl_->walk(slices, source.grid().layers, context);
}

FlowPart::~FlowPart() = default;
FlowPart::FlowPart(FlowPart&&) noexcept = default;

int FlowPart::slices() const { return static_cast<int>(impl_->mask_of.size()); }
double FlowPart::layer_um() const { return impl_->layer_um; }
const FlowGrid& FlowPart::grid() const { return impl_->grid; }
std::size_t FlowPart::masks() const { return impl_->first_slice_of.size(); }
int FlowPart::mask_of(int slice) const {
  return impl_->mask_of.at(static_cast<std::size_t>(slice));
}
int FlowPart::first_slice_of(std::size_t mask) const { return impl_->first_slice_of.at(mask); }

FlowSection FlowPart::section(std::size_t mask) const {
  const FlowGrid& g = impl_->grid;
  FlowSection section;
  section.width = g.columns;
  section.height = g.rows;
  section.pitch_x_um = section.pitch_y_um = g.pitch_um;
  std::vector<std::uint8_t> bytes(4 * g.cells());
  impl_->masks.read(static_cast<int>(mask), bytes.data());
  MaskBytes::to_section(bytes, section);
  return section;
}

const std::vector<BlindVoid>& FlowPart::blind() const { return impl_->blind; }
std::size_t FlowPart::bytes() const {
  return impl_->masks.bytes() + sizeof(int) * impl_->mask_of.capacity();
}

}  // namespace slicecorr
