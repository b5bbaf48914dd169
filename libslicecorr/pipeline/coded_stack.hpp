/// A whole stack of slices that is made band by band and read as a source.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/coded_band.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/target.hpp"
#include "stack/blob_store.hpp"

namespace slicecorr::detail {

/// Holds the run-length code of all bands, the first `kMemoryBytes` of it in memory and the rest in
/// a scratch file without a name. Thread-safe, but for bands that are read before they were put.
class CodedStack final : public SliceSource {
 public:
  /// Slices of `grid` that lie like `frame`, all black. `bands` are boxes of the same columns that
  /// follow each other from the top row down; pixels outside them stay black.
  CodedStack(const Grid& grid, const ImageFrame& frame, std::vector<PixelBox> bands,
             const std::string& scratch_folder, const ExecutionContext& context);

  const std::vector<PixelBox>& bands() const { return bands_; }
  /// All slices of a band, once, from the first to the last.
  void put(std::size_t band, const CodedBand& coded);

  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return bounds_; }
  ImageFrame frame() const override { return frame_; }
  void read_band(const PixelBox& band, const Sink& sink) const override;

 private:
  static constexpr std::size_t kMemoryBytes = std::size_t{256} << 20;
  struct Held {
    BlobStore::Blob code;
    std::vector<std::size_t> ends;
  };
  Grid grid_;
  ImageFrame frame_;
  std::vector<PixelBox> bands_;
  PixelBox bounds_;
  std::vector<Held> held_;
  BlobStore store_;
};

}  // namespace slicecorr::detail
