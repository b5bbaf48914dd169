// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/recording_writer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <vector>

#include "base/run_length.hpp"
#include "pipeline/uv_images.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/version.hpp"
#include "stack/blob_store.hpp"

namespace slicecorr {

namespace {

constexpr std::size_t kMemoryBudget = std::size_t{64} << 20;

std::string folder_beside(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return folder.empty() ? "." : folder;
}

/// UV images of an even dead zone, which go by place and slice.
struct ImagesByPlace {
  Setup setup;  ///< outlives the images
  EvenUvImages images;
  explicit ImagesByPlace(const StackInfo& print)
      : setup{*print.printer, *print.resin, *print.process, 0},
        images(setup, print.grid, image_frame(print)) {}
};

}  // namespace

/// A piece in the store is the run-length code of a whole image: bands of the archive are only
/// known once the number of images is.
struct RecordingWriter::Impl {
  std::string path;
  StackInfo info;
  ExecutionContext context;
  BlobStore store;
  std::size_t pixels = 0;
  std::vector<BlobStore::Blob> images;
  /// UV pixel value of each pixel value, where the lamp is patterned.
  std::optional<std::array<std::uint8_t, 256>> uv_of_pixel;
  std::vector<int> other_uv_images;
  std::vector<std::uint8_t> code;
  // Where UV images go by place: only the record says to which slices images belong.
  std::unique_ptr<const ImagesByPlace> by_place;
  std::vector<BlobStore::Blob> uv_images;
  std::vector<int> slice_of;  ///< of each image, by its UV image

  Impl(const std::string& p, const StackInfo& print, const ExecutionContext& j)
      : path(p), info(print), context(j), store(folder_beside(p), kMemoryBudget, j) {
    // A print that was stopped has a record, too.
    context.cancel = nullptr;
  }
  bool follows(const std::uint8_t* blue, const std::uint8_t* uv) const;
  void write_images(StackWriter& writer, int count) const;
  void find_slices(const Recording& shown);
  bool is_uv_of(int slice, const std::vector<std::uint8_t>& blue,
                const std::vector<std::uint8_t>& uv) const;
  void unpack(const BlobStore::Blob& blob, std::vector<std::uint8_t>& image) const;
  BlobStore::Blob pack(const std::uint8_t* image) {
    code.clear();
    detail::run_length_encode(image, pixels, code);
    return store.put(code.data(), code.size());
  }
};

RecordingWriter::RecordingWriter(const std::string& path, const StackInfo& print,
                                 const ExecutionContext& context) {
  if (!path.ends_with(".uvj")) {
    throw InputError(path, "", "a recording is written as a UVJ archive; expected a name.uvj");
  }
  // Checked now, not only when the print is over.
  if (!std::filesystem::is_directory(folder_beside(path)) || std::filesystem::is_directory(path)) {
    throw InputError(path, "", "can't be written: expected a new file in a folder that is there");
  }
  if (!print.printer || !print.resin || !print.process) {
    throw InputError(path, "",
                     "a recording needs to know what is printed; expected a corrected stack with "
                     "its printer, resin and process");
  }
  const Grid& grid = print.grid;
  if (grid.width_px < 1 || grid.height_px < 1 || !(grid.layer_um > 0)) {
    throw std::invalid_argument("a recording needs the size of images and layers");
  }
  impl_ = std::make_unique<Impl>(path, print, context);
  Impl& s = *impl_;
  s.pixels = static_cast<std::size_t>(grid.width_px) * static_cast<std::size_t>(grid.height_px);
  s.info.kind = StackKind::recorded;
  s.info.program = std::string("slicecorr ") + version;
  if (print.process->uv.kind != UvKind::patterned) return;
  if (print.process->even_light) {
    s.by_place = std::make_unique<const ImagesByPlace>(print);
    return;
  }
  const PlaceModels models(*print.printer, *print.resin, *print.process, grid, image_frame(print));
  s.uv_of_pixel = detail::uv_of_pixels(models.brightest(), print.printer->levels());
}

RecordingWriter::~RecordingWriter() = default;

int RecordingWriter::images() const { return static_cast<int>(impl_->images.size()); }

/// Whether the UV image is the one that goes with the blue one.
bool RecordingWriter::Impl::follows(const std::uint8_t* blue, const std::uint8_t* uv) const {
  if (!uv_of_pixel) return true;
  if (!uv) return false;
  for (std::size_t i = 0; i < pixels; ++i) {
    if (uv[i] != (*uv_of_pixel)[blue[i]]) return false;
  }
  return true;
}

int RecordingWriter::add_image(const std::uint8_t* blue, const std::uint8_t* uv) {
  Impl& s = *impl_;
  const int index = images();
  s.images.push_back(s.pack(blue));
  if (s.by_place) {
    const std::vector<std::uint8_t> none(uv ? 0 : s.pixels, 0);
    s.uv_images.push_back(s.pack(uv ? uv : none.data()));
  } else if (!s.follows(blue, uv)) {
    s.other_uv_images.push_back(index);
  }
  return index;
}

void RecordingWriter::Impl::unpack(const BlobStore::Blob& blob,
                                   std::vector<std::uint8_t>& image) const {
  std::vector<std::uint8_t> packed;
  store.get(blob, packed);
  image.resize(pixels);
  detail::run_length_decode(packed.data(), packed.data() + packed.size(), image.data(), pixels);
}

bool RecordingWriter::Impl::is_uv_of(int slice, const std::vector<std::uint8_t>& blue,
                                     const std::vector<std::uint8_t>& uv) const {
  const auto width = static_cast<std::size_t>(info.grid.width_px);
  std::vector<std::uint8_t> row(width);
  for (int y = 0; y < info.grid.height_px; ++y) {
    const std::size_t first = static_cast<std::size_t>(y) * width;
    std::copy_n(blue.begin() + static_cast<std::ptrdiff_t>(first), width, row.begin());
    by_place->images.make_row(slice, y, row);
    if (std::memcmp(row.data(), uv.data() + first, width) != 0) return false;
  }
  return true;
}

/// To which slice each image belongs: one in which it was shown, or, of images that came late or early, one beside.
void RecordingWriter::Impl::find_slices(const Recording& shown) {
  std::vector<int> first(images.size(), -1), last(images.size(), -1);
  for (int n = 0; n < shown.slices(); ++n) {
    for (const Recording::Showing& p : shown.of(n)) {
      if (p.image < 0 || !(p.light > 0)) continue;
      const auto i = static_cast<std::size_t>(p.image);
      if (first[i] < 0) first[i] = n;
      last[i] = n;
    }
  }
  slice_of.assign(images.size(), 0);
  std::vector<std::uint8_t> others(images.size(), 0);
  parallel_for(context, "look at UV images", images.size(), [&](std::size_t i) {
    if (first[i] < 0) return;
    std::vector<std::uint8_t> blue, uv;
    unpack(images[i], blue);
    unpack(uv_images[i], uv);
    slice_of[i] = first[i];
    for (int n = std::max(0, first[i] - 1); n <= last[i] + 1; ++n) {
      if (!is_uv_of(n, blue, uv)) continue;
      slice_of[i] = n;
      return;
    }
    others[i] = 1;
  });
  for (std::size_t i = 0; i < others.size(); ++i) {
    if (others[i]) other_uv_images.push_back(static_cast<int>(i));
  }
}

void RecordingWriter::Impl::write_images(StackWriter& writer, int count) const {
  constexpr int at_once = 16;
  const int height = info.grid.height_px;
  const auto groups = static_cast<std::size_t>((count + at_once - 1) / at_once);
  parallel_for(context, "record", groups, [&](std::size_t g) {
    StackWriter::BandEncoder encoder(writer, 0, height);
    std::vector<std::uint8_t> image;
    const int first = static_cast<int>(g) * at_once;
    for (int n = first; n < std::min(count, first + at_once); ++n) {
      unpack(images[static_cast<std::size_t>(n)], image);
      encoder.put(n, 0, info.grid.width_px, image.data());
    }
  });
}

void RecordingWriter::finish(Recording shown) {
  Impl& s = *impl_;
  check_recording(shown, images(), s.path);
  if (s.by_place) s.find_slices(shown);
  shown.other_uv_images = s.other_uv_images;
  s.info.grid.layers = std::max(1, images());
  s.info.recording = std::make_shared<const Recording>(std::move(shown));
  StackWriter writer(s.path, s.info.grid, s.context);
  if (s.uv_of_pixel) writer.set_uv_pattern(*s.uv_of_pixel);
  if (s.by_place) {
    writer.set_uv_pattern(s.by_place->images.of_black(),
                          [&s](int image, int y, std::span<std::uint8_t> row) {
                            const auto i = static_cast<std::size_t>(image);
                            const int slice = i < s.slice_of.size() ? s.slice_of[i] : 0;
                            s.by_place->images.make_row(slice, y, row);
                          });
  }
  if (images() == 0) {
    StackWriter::BandEncoder(writer, 0, s.info.grid.height_px)
        .put(0, 0, s.info.grid.width_px, nullptr);
  }
  s.write_images(writer, images());
  writer.finish(s.info, {});
}

}  // namespace slicecorr
