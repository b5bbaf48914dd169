// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <cstring>
#include <stdexcept>

#include "base/run_length.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/print_file.hpp"
#include "stack/block_check.hpp"
#include "stack/coded_images.hpp"
#include "stack/flat_field_entry.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/formats/png_archive.hpp"
#include "stack/formats/uvj_config.hpp"
#include "stack/layer_encoding.hpp"
#include "stack/layer_places.hpp"
#include "stack/recording_entry.hpp"
#include "stack/stack_writer_parts.hpp"

namespace slicecorr {
namespace {

using detail::PixelCode;

/// Memory for all pieces together, bytes. Beyond it a piece costs two system calls, some
/// microseconds.
constexpr std::size_t kWriterMemory = std::size_t{32} << 20;

}  // namespace

StackWriter::Impl::Impl(const StackFile& f, const Grid& g, const ExecutionContext& j)
    : grid(g),
      context(j),
      file(f),
      format(detail::format_named(f.format, f.path)),
      output(detail::make_container_output(
          f.path, format.container(), f.keep_from,
          // Our own archives are read slice by slice, in any order, and should be read fast.
          f.archive                          ? detail::ImagePacking::smallest
          : &format == &detail::uvj_format() ? detail::ImagePacking::stored
                                             : detail::ImagePacking::deflated)),
      store(output->folder(), kWriterMemory, j),
      rows(band_rows(g)),
      bands(static_cast<std::size_t>((g.height_px + rows - 1) / rows)) {
  if (!file.keep_from.empty()) {
    open_kept();
  } else if (format.packs_rgb()) {
    code = {1, 0, 8, 2, true, format.packs_bgr()};
  } else if (format.codes_layers()) {
    check_can_be_made(f, false);
    codec = format.new_codec(g);
  }
  if (!code.is_plain()) grey_adlers.resize(bands.size());
}

bool StackWriter::Impl::changes_exposures(const StackInfo& info) const {
  if (!kept) return true;
  return codec ? detail::replaces_exposures(info, kept_contents.info)
               : detail::exposures_differ(info, kept_contents.info);
}

bool StackWriter::Impl::changes_light(const StackInfo& info) const {
  return !kept || detail::shares_differ(info, kept_contents.info);
}

/// What the format has no word for is not written: the print would be another one.
void StackWriter::Impl::check_layers(const StackInfo& info) const {
  const auto refuse = [&](const char* what, const char* expected) {
    throw InputError(
        file.path, "",
        fmt::format("files of the format {} {}; expected {}", format.name(), what, expected));
  };
  if (!format.says_light() && changes_light(info)) {
    for (int n = 0; n < info.grid.layers; ++n) {
      const double share = detail::share_of_layer(info, n);
      if (share == 1) continue;
      refuse(fmt::format(
                 "can't say that layers get less than full light, and layer {} gets {:.4g} % of "
                 "it",
                 n, 100 * share)
                 .c_str(),
             "a format that can, as GOO, CTB or UVJ");
    }
  }
  if (!kept && !format.says_heights()) {
    for (int n = 0; n < info.grid.layers; ++n) {
      const double um = layer_height_um(info, n);
      if (um == info.grid.layer_um) continue;
      refuse(fmt::format(
                 "can't say that layers are of different heights, and layer {} is {:g} um high, "
                 "others {:g} um",
                 n, um, info.grid.layer_um)
                 .c_str(),
             "a format that can, as GOO, CTB or UVJ");
    }
  }
  if (kept && !kept_contents.info.exposures.empty() && !format.changes_exposures()) {
    refuse("are not changed where layers are exposed more than once", "a CTB or GOO file");
  }
}

void StackWriter::Impl::begin_band(std::size_t band) {
  const std::scoped_lock lock(mutex);
  if (bands[band].empty()) bands[band].resize(static_cast<std::size_t>(grid.layers));
  if (!grey_adlers.empty() && grey_adlers[band].empty()) {
    grey_adlers[band].resize(static_cast<std::size_t>(grid.layers));
  }
  if (uv_of_pixel && uv_bands[band].empty()) {
    uv_bands[band].resize(static_cast<std::size_t>(grid.layers));
  }
  if (!edge_bands.empty() && edge_bands[band].empty()) {
    edge_bands[band].resize(static_cast<std::size_t>(grid.layers) + 1);
  }
}

/// Opens the archive that is changed. New images get the pixel code of those that it has, since its
/// readers expect that.
void StackWriter::Impl::open_kept() {
  kept = detail::open_container(file.keep_from, output->folder(), context);
  if (format.container() != kept->kind() || !format.recognises(*kept)) {
    throw InputError(file.keep_from, "",
                     "is no archive of the format " + std::string(format.name()));
  }
  kept_contents = detail::read_with_places(format, *kept);
  if (kept_contents.codec) {
    codec = kept_contents.codec;
    const Grid& its = kept_contents.info.grid;
    if (its.width_px != grid.width_px || its.height_px != grid.height_px) {
      throw InputError(file.keep_from, "",
                       fmt::format("has slices of {} x {} pixels, expected {} x {}", its.width_px,
                                   its.height_px, grid.width_px, grid.height_px));
    }
    return;
  }
  const std::string& first = kept_contents.images.front();
  if (kept_contents.packed_rgb) {
    code = {1, 0, 8, 2, true, kept_contents.packed_bgr};
    return;
  }
  std::vector<std::uint8_t> png;
  kept->read(*kept->find(first), std::uint64_t{1} << 32, png);
  const auto its = detail::read_png_header(png, {file.keep_from, first}).code();
  if (its) {
    code = *its;
  } else {
    context.tell(file.keep_from +
                 ": images of fewer than 8 bits can't hold grey levels: they become 8-bit grey");
  }
}

std::map<int, StackWriter::Impl::Black> StackWriter::Impl::make_black(
    std::uint8_t value, const PixelCode& pixels) const {
  std::map<int, Black> black;
  detail::IdatEncoder encoder;
  std::vector<std::uint8_t> expanded;
  for (const std::size_t band : {std::size_t{0}, bands.size() - 1}) {
    Black& b = black[rows_of(band)];
    if (!b.chunk.empty()) continue;
    const std::vector<std::uint8_t> plain = plain_band(band, value);
    b.grey_adler = detail::adler_of(plain);
    if (pixels.is_plain()) {
      b.adler = encoder.encode(plain, b.chunk);
    } else {
      pixels.expand(plain, grid.width_px, expanded);
      b.adler = encoder.encode(expanded, b.chunk);
    }
  }
  return black;
}

StackWriter::Impl::Images StackWriter::Impl::gather(const std::vector<Pieces>& from,
                                                    std::uint8_t background, std::size_t layers,
                                                    const PixelCode& pixels) const {
  Images images{from,
                pixels,
                make_black(background, pixels),
                std::vector<std::uint32_t>(layers),
                std::vector<std::uint32_t>(layers),
                std::vector<std::uint64_t>(layers),
                {}};
  const bool plain = pixels.is_plain();
  const std::size_t stride = pixels.stride(grid.width_px);
  // In parallel: there may be a hundred thousand slices of hundreds of bands.
  parallel_for(detail::silent(context), "", layers, [&](std::size_t slice) {
    std::uint32_t adler = 1, grey_adler = 1;
    std::uint64_t size = detail::kPngFrameBytes;
    for (std::size_t band = 0; band < from.size(); ++band) {
      const Black& b = images.black.at(rows_of(band));
      const bool is_lit = images.lit(band, slice);
      size += is_lit ? from[band][slice].size : b.chunk.size();
      adler = detail::join_adler(adler, is_lit ? from[band][slice].adler : b.adler,
                                 stride * static_cast<std::size_t>(rows_of(band)));
      if (plain) continue;
      grey_adler = detail::join_adler(grey_adler, is_lit ? grey_adlers[band][slice] : b.grey_adler,
                                      raw_size(band));
    }
    images.adlers[slice] = adler;
    images.grey_adlers[slice] = plain ? adler : grey_adler;
    images.sizes[slice] = size;
  });
  return images;
}

/// Packs each slice once more, all its bands together.
void StackWriter::Impl::make_small(Images& images) {
  images.small.resize(images.sizes.size());
  const std::size_t stride = images.code.stride(grid.width_px);
  parallel_for(context, "pack", images.small.size(), [&](std::size_t slice) {
    detail::SmallIdat packer;
    std::vector<std::uint8_t> chunk;
    for (std::size_t band = 0; band < images.bands.size(); ++band) {
      const std::size_t raw_bytes = stride * static_cast<std::size_t>(rows_of(band));
      if (images.lit(band, slice)) {
        chunk.clear();
        store.get(images.bands[band][slice], chunk);
        packer.add(chunk, raw_bytes);
      } else {
        packer.add(images.black.at(rows_of(band)).chunk, raw_bytes);
      }
    }
    chunk.clear();
    packer.finish(images.adlers[slice], chunk);
    images.small[slice] = store.put(chunk.data(), chunk.size());
    images.sizes[slice] = detail::kPngFrameBytesOfOne + chunk.size();
  });
}

void StackWriter::Impl::add_images(const std::vector<std::string>& names, const Images& images) {
  output->add_lazily(names, images.sizes, [&](std::size_t slice, std::vector<std::uint8_t>& png) {
    if (!images.small.empty()) {
      detail::append_png_header(grid.width_px, grid.height_px, images.code, png);
      store.get(images.small[slice], png);
      detail::append_png_iend(png);
      return;
    }
    detail::append_png_start(grid.width_px, grid.height_px, images.code, png);
    for (std::size_t band = 0; band < images.bands.size(); ++band) {
      if (images.lit(band, slice)) {
        store.get(images.bands[band][slice], png);
      } else {
        const std::vector<std::uint8_t>& chunk = images.black.at(rows_of(band)).chunk;
        png.insert(png.end(), chunk.begin(), chunk.end());
      }
    }
    detail::append_png_end(images.adlers[slice], png);
  });
}

void StackWriter::Impl::write_archive(const StackInfo& its_info, const GreyImage& preview) {
  StackInfo info = its_info;
  info.has_edge_heights = !edge_bands.empty();
  if (file.machine_height_mm > 0) info.machine_height_mm = file.machine_height_mm;
  if (!(info.machine_height_mm > 0) && info.printer) {
    info.machine_height_mm = info.printer->travel_mm;
  }
  check_layers(info);
  if (codec) return write_coded(info, preview);
  const auto layers = static_cast<std::size_t>(info.grid.layers);
  Images slices = gather(bands, 0, layers, code);
  std::optional<Images> uv, edges;
  if (uv_of_pixel) uv.emplace(gather(uv_bands, (*uv_of_pixel)[0], layers, {}));
  if (info.has_edge_heights) edges.emplace(gather(edge_bands, 0, layers + 1, {}));
  if (file.archive) {
    make_small(slices);
    if (uv) make_small(*uv);
    if (edges) make_small(*edges);
  }
  std::vector<std::string> warnings;
  detail::ArchiveRequest request{
      .info = info,
      .stem = stem(),
      .checksums = {.slices = detail::images_crc32(slices.grey_adlers)},
      .preview = preview,
      .kept = kept.get(),
      .kept_contents = kept ? &kept_contents : nullptr,
      .exposure_changes = changes_exposures(info),
      .light_changes = changes_light(info),
      .warnings = &warnings,
  };
  if (uv) request.checksums.uv = detail::images_crc32(uv->grey_adlers);
  if (edges) request.checksums.edges = detail::images_crc32(edges->grey_adlers);
  const std::vector<std::string> names = format.write(request, *output);
  if (!format.says_lifts()) detail::tell_lifts_left(request, format.name());
  for (const std::string& warning : warnings) context.tell(file.path + ": " + warning);
  add_images(names, slices);
  const auto add_more = [&](const Images& images, std::string (*name_of)(int)) {
    std::vector<std::string> more_names(images.sizes.size());
    for (std::size_t n = 0; n < more_names.size(); ++n)
      more_names[n] = name_of(static_cast<int>(n));
    add_images(more_names, images);
  };
  if (uv) add_more(*uv, detail::uv_image_name);
  if (edges) add_more(*edges, detail::edge_image_name);
  // Only our record in a folder says what the stack is, and that the folder may be replaced.
  if (&format != &detail::uvj_format() &&
      (info.kind != StackKind::foreign || &format == &detail::folder_format())) {
    output->add_text(detail::kProvenanceEntry,
                     detail::write_provenance(info, request.checksums) + "\n");
  }
  if (info.kind != StackKind::foreign) detail::add_flat_field(info, *output);
  detail::add_recording(info, *output);
  output->finish(context, [&](const std::string& written) {
    if (kept) check_rewritten(written, info);
    if (file.before_renaming) file.before_renaming();
  });
}

/// The image of a slice, from the runs of its bands.
void StackWriter::Impl::read_pixels(std::size_t slice, std::uint8_t* pixels) const {
  const auto width = static_cast<std::size_t>(grid.width_px);
  std::memset(pixels, 0, width * static_cast<std::size_t>(grid.height_px));
  std::vector<std::uint8_t> code_bytes, some;
  for (std::size_t band = 0; band < bands.size(); ++band) {
    if (bands[band].empty() || bands[band][slice].size == 0) continue;
    code_bytes.clear();
    store.get(bands[band][slice], code_bytes);
    std::int32_t columns[2];
    std::memcpy(columns, code_bytes.data(), sizeof columns);
    const auto columns_wide = static_cast<std::size_t>(columns[1] - columns[0]);
    some.resize(columns_wide * static_cast<std::size_t>(rows_of(band)));
    detail::run_length_decode(code_bytes.data() + sizeof columns,
                              code_bytes.data() + code_bytes.size(), some.data(), some.size());
    std::uint8_t* to = pixels + width * band * static_cast<std::size_t>(rows) + columns[0];
    for (std::size_t at = 0; at < some.size(); at += columns_wide, to += width) {
      std::memcpy(to, some.data() + at, columns_wide);
    }
  }
}

/// The coded images of an archive, where these are entries of their own: those that change. Others keep
/// their bytes, packed as they are.
void StackWriter::Impl::add_coded(const std::vector<std::string>& names,
                                  const detail::EncodedLayers& coded) {
  std::vector<std::string> changed;
  std::vector<std::uint64_t> sizes;
  std::vector<std::size_t> pieces;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (coded.as_kept[i]) continue;
    changed.push_back(names[i]);
    sizes.push_back(coded.layers.sizes[i]);
    pieces.push_back(i);
  }
  output->add_lazily(
      changed, sizes,
      [append = coded.layers.append, pieces](std::size_t i, std::vector<std::uint8_t>& out) {
        append(pieces[i], out);
      });
}

void StackWriter::Impl::write_coded(const StackInfo& info, const GreyImage& preview) {
  if (uv_of_pixel) {
    throw InputError(
        file.path, "",
        fmt::format("the format {} has no place for UV images; expected UVJ", format.name()));
  }
  if (info.kind == StackKind::recorded) {
    throw InputError(
        file.path, "",
        fmt::format("the format {} has no place for a recording; expected UVJ", format.name()));
  }
  if (info.kind == StackKind::corrected && info.printer &&
      !file_holds_levels(codec->shown(), *info.printer)) {
    throw InputError(
        file.path, "",
        fmt::format(
            "the stack was corrected with {} grey levels, of which the format {} "
            "holds {}; expected the design to be converted into this format first, with a file of "
            "the printer's slicer as the template where it needs one, and the result to be "
            "corrected",
            info.printer->levels(), format.name(), detail::levels_of(codec->shown())));
  }
  const StackInfo images = kept ? detail::image_by_image(info, kept_contents) : info;
  const detail::ArchiveContents kept_images = detail::image_by_image(kept_contents);
  const auto read_image = [&](std::size_t image, std::uint8_t* pixels) {
    if (!kept || !detail::is_spot(kept_contents, image)) {
      read_pixels(static_cast<std::size_t>(detail::layer_of_image(kept_contents, image)), pixels);
      return;
    }
    detail::decode_image(*kept, kept_contents, image, pixels);
  };
  detail::EncodedLayers coded = detail::encode_layers(
      *codec, grid, static_cast<std::size_t>(images.grid.layers), read_image, kept.get(),
      kept_contents,
      info.kind != StackKind::foreign,  // those of other programs get no record
      store, context);
  coded.layers.append = [&](std::size_t piece, std::vector<std::uint8_t>& out) {
    store.get(coded.pieces[piece], out);
  };
  if (coded.rounded_pixels > 0) {
    const int levels = detail::levels_of(codec->shown());
    context.tell(fmt::format("{}: holds {} grey levels: {} pixels are rounded to the nearest{}",
                             file.path, levels, coded.rounded_pixels,
                             levels > 2
                                 ? ""
                                 : "; no correction can be written into it, since it has no grey: "
                                   "take a template that the slicer exported with anti-aliasing"));
  }
  std::vector<std::string> warnings;
  // What stands for a layer is its last image that is no spot.
  std::vector<std::uint32_t> adlers(static_cast<std::size_t>(info.grid.layers));
  for (std::size_t k = 0; k < coded.adlers.size(); ++k) {
    if (kept && detail::is_spot(kept_contents, k)) continue;
    adlers[static_cast<std::size_t>(detail::layer_of_image(kept_contents, k))] = coded.adlers[k];
  }
  const detail::ArchiveRequest request{
      .info = images,
      .stem = stem(),
      .checksums = {.slices = detail::images_crc32(adlers)},
      .preview = preview,
      .kept = kept.get(),
      .kept_contents = kept ? &kept_images : nullptr,
      .exposure_changes = changes_exposures(info),
      .light_changes = changes_light(info),
      .warnings = &warnings,
      .layers = &coded.layers,
  };
  add_coded(format.write(request, *output), coded);
  for (const std::string& warning : warnings) context.tell(file.path + ": " + warning);
  if (info.kind != StackKind::foreign) {
    output->add_text(detail::kProvenanceEntry,
                     detail::write_provenance(info, request.checksums) + "\n");
    detail::add_flat_field(info, *output);
  }
  output->finish(context, [&](const std::string& written) {
    if (kept) check_rewritten(written, info);
    if (file.before_renaming) file.before_renaming();
  });
}

/// Reads a rewritten archive back before it gets its name, and throws unless it says what was
/// meant: a time that is wrong in it would be wrong in the print.
void StackWriter::Impl::check_rewritten(const std::string& written, const StackInfo& info) const {
  const auto refuse = [&](const std::string& what) {
    throw InputError(
        file.keep_from, "",
        "can't be changed: read back after writing, it " + what + "; the archive is left as it is");
  };
  StackInfo now;
  try {
    const auto archive = detail::open_container(written, output->folder());
    now = detail::read_contents(*archive).info;
    // Times of corrected stacks were compared while reading.
    if (info.kind == StackKind::foreign) {
      detail::check_times(changes_exposures(info) ? info : kept_contents.info, now, written);
    }
  } catch (const InputError& e) {
    std::string text = e.what();
    if (text.starts_with(written + ": ")) text.erase(0, written.size() + 2);
    refuse("is no sound archive of its format (" + text + ")");
  }
  if (now.grid.layers != info.grid.layers || now.grid.width_px != info.grid.width_px ||
      now.grid.height_px != info.grid.height_px) {
    refuse("has " + std::to_string(now.grid.layers) + " slices of " +
           std::to_string(now.grid.width_px) + " x " + std::to_string(now.grid.height_px) +
           " pixels, expected " + std::to_string(info.grid.layers) + " of " +
           std::to_string(info.grid.width_px) + " x " + std::to_string(info.grid.height_px));
  }
  if (now.kind != info.kind || now.process != info.process || now.resin != info.resin ||
      (info.kind != StackKind::foreign && !now.parameters_checked)) {
    refuse("has another record than was written");
  }
}

/// The file's name without the ending that its format gives it.
std::string StackWriter::Impl::stem() const {
  std::string name = detail::path_parts(file.path).file;
  for (const std::string_view ending : format.endings()) {
    if (name.size() > ending.size() && name.ends_with(ending)) {
      name.resize(name.size() - ending.size());
      return name;
    }
  }
  const std::size_t point = name.rfind('.');
  return point == std::string::npos || point == 0 ? name : name.substr(0, point);
}

StackWriter::StackWriter(const StackFile& file, const Grid& grid, const ExecutionContext& context) {
  if (grid.width_px < 1 || grid.height_px < 1 || grid.layers < 1) {
    throw std::invalid_argument("a stack needs at least one pixel and one slice");
  }
  impl_ = std::make_unique<Impl>(file, grid, context);
}

StackWriter::~StackWriter() = default;

void StackWriter::set_uv_pattern(const std::array<std::uint8_t, 256>& uv_of_pixel) {
  impl_->uv_of_pixel = uv_of_pixel;
  impl_->uv_bands.resize(impl_->bands.size());
}

void StackWriter::set_uv_pattern(std::uint8_t of_black, UvRows rows) {
  set_uv_pattern({of_black});
  impl_->uv_rows = std::move(rows);
}

bool StackWriter::keep_edge_heights() {
  Impl& s = *impl_;
  if (&s.format == &detail::uvj_format()) {
    s.edge_bands.resize(s.bands.size());
    return true;
  }
  s.context.tell(s.file.path +
                 ": only UVJ archives have a place for edge heights: edges lie at nodes here");
  return false;
}

void StackWriter::finish(const StackInfo& info, const GreyImage& preview) {
  const Grid& grid = impl_->grid;
  if (info.grid.width_px != grid.width_px || info.grid.height_px != grid.height_px ||
      info.grid.layers < 1 || info.grid.layers > grid.layers) {
    throw std::invalid_argument("the info of a stack does not fit its images");
  }
  impl_->write_archive(info, preview);
}

}  // namespace slicecorr
