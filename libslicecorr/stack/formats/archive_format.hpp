// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file archive_format.hpp
/// One class per archive format: what is in it, and what a new or changed one says. Images are read
/// and written by StackReader and StackWriter, alike for all formats.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/stack.hpp"
#include "stack/container/container.hpp"
#include "stack/container/container_output.hpp"
#include "stack/formats/exposure_pattern.hpp"
#include "stack/formats/key_value_text.hpp"
#include "stack/layer_code/codes.hpp"

namespace slicecorr::detail {

/// What the block of a recorded stack says of its table.
struct RecordingFacts {
  int slices = 0, showings = 0;
  std::uint32_t crc32 = 0;
  std::vector<int> other_uv_images;
};

/// What an archive says.
struct ArchiveContents {
  /// Without `format`, which the reader sets. Pixel sizes are 0 where the archive does not say
  /// them; the layer height, too.
  StackInfo info;
  std::vector<std::string> images;       ///< entry of each slice; as many as info.grid.layers
  std::vector<std::string> uv_images;    ///< the same in UV light; empty without
  std::vector<std::string> edge_images;  ///< edge heights, one more than layers; empty without
  /// Three neighbouring pixels lie in one RGB pixel: images are ceil(width / 3) wide.
  bool packed_rgb = false;
  bool packed_bgr = false;  ///< and the first of the three is the blue one, not the red one
  /// Fingerprints that our block holds, see `images_crc32`; absent in foreign archives.
  std::optional<std::uint32_t> images_crc32, uv_images_crc32, edge_images_crc32;
  /// The block has a checksum, and it is that of other parameters; see `check_block`.
  bool block_changed = false;
  /// The format says layer heights in steps of this, um; 0: exactly.
  double layer_step_um = 0;
  /// CRC-32 of the values of `info.printer`'s flat-field, whose picture is an entry of its own.
  std::optional<std::uint32_t> flat_field_crc32;
  std::optional<std::uint32_t> uv_flat_field_crc32;  ///< of its UV lamp's
  std::optional<RecordingFacts> recording;           ///< of a recorded stack
  /// Where layers have a code of the format's own: this code. Their pieces, those of layer n from
  /// n * codec->pieces() on, are the entries `images`, or in a binary file lie at `places`, `images` being
  /// empty then.
  LayerCodecPtr codec;
  /// What else a print file says, for people: name and value.
  std::vector<std::pair<std::string, std::string>> facts;
  struct Place {
    std::uint64_t offset = 0, size = 0;
  };
  std::vector<Place> places;
  /// Where the platform stands for each image, mm; empty where the archive does not say it.
  std::vector<double> z_mm;
  double z_step_um = 0;  ///< places are told in steps of this
  std::vector<std::string> warnings;
};

/// Fingerprints of a stack's sets of images, see `images_crc32`; of UV images and edge heights
/// where there are some.
struct ImageChecksums {
  std::uint32_t slices = 0;
  std::optional<std::uint32_t> uv{}, edges{};
};

/// The coded layers of a print file that is written.
struct CodedLayers {
  const LayerCodec& codec;
  std::vector<std::uint64_t> sizes{};       ///< of pieces, those of layer n from n * pieces() on
  std::vector<std::uint64_t> lit_pixels{};  ///< of each layer
  /// Appends a piece, by its place in `sizes`. Lives as long as what is written.
  std::function<void(std::size_t piece, std::vector<std::uint8_t>& out)> append{};
};

/// What is to be written besides images.
struct ArchiveRequest {
  const StackInfo& info;
  std::string stem;  ///< file name without its ending
  ImageChecksums checksums;
  const GreyImage& preview;  ///< grey relief of the part; may be empty
  /// The archive that is changed, and what it says; null for a new one.
  const Container* kept = nullptr;
  const ArchiveContents* kept_contents = nullptr;
  /// Whether the exposure times of `info` are to replace those of the kept archive.
  bool exposure_changes = true;
  /// The same of the shares of light.
  bool light_changes = true;
  std::vector<std::string>* warnings = nullptr;  ///< what the format can't say is told here
  const CodedLayers* layers = nullptr;           ///< of a format that codes layers itself
};

/// Whether printers lift after each layer, whatever a file of the format says: where one maker's boards read
/// it, surely; as a rule where machines of people's own read it, too.
enum class PrintersLift { not_known, as_a_rule, always };

/// Stateless and thread-safe.
class ArchiveFormat {
 public:
  virtual ~ArchiveFormat() = default;
  virtual std::string_view name() const = 0;  ///< "sl1"
  virtual std::string_view what() const = 0;  ///< "Prusa SL1 and SL1S"
  /// Endings of file names, with the point; the first is the usual one.
  virtual std::vector<std::string_view> endings() const = 0;
  virtual ContainerKind container() const { return ContainerKind::zip; }
  /// Whether layers have a code of the format's own: no PNG images.
  virtual bool codes_layers() const { return container() == ContainerKind::binary; }
  virtual PrintersLift printers_lift() const {
    return codes_layers() ? PrintersLift::always : PrintersLift::not_known;
  }
  /// Whether images of new archives are RGB-packed.
  virtual bool packs_rgb() const { return false; }
  virtual bool packs_bgr() const { return false; }  ///< see ArchiveContents
  /// Whether archives are made from nothing; else only such that are there are changed.
  virtual bool made_new() const { return true; }
  /// Whether archives say how bright layers are lit, and how high each of them is: what they can't say is
  /// not written.
  virtual bool says_light() const { return false; }
  virtual bool says_heights() const { return false; }
  /// Whether new archives say how the platform lifts as the archive did that the slices are of; elsewhere it
  /// is told that this is left behind.
  virtual bool says_lifts() const { return false; }
  /// Whether archives are changed of which layers have several exposures.
  virtual bool changes_exposures() const { return false; }
  /// Of formats that code layers themselves, the code of a new file.
  virtual LayerCodecPtr new_codec(const Grid&) const { return nullptr; }

  /// Whether the archive is of this format, by the names of its entries and, where those do not
  /// tell, by contents. Called only for archives in the format's own kind of container.
  virtual bool recognises(const Container& archive) const = 0;
  /// Throws `InputError` on anything damaged, missing, misnamed or absurdly large. Sizes of images
  /// that the archive does not say are read with `image_size`.
  virtual ArchiveContents read(const Container& archive) const = 0;
  /// Adds all entries but the images, and gives the names of the images of slices 0, 1, ... Binary
  /// formats add the pieces of the whole file, with its layers, and give no names.
  virtual std::vector<std::string> write(const ArchiveRequest& request,
                                         ContainerOutput& output) const = 0;
  /// The picture of the part for people to choose by, as PNG, whoever wrote it; empty without one. Of
  /// archives with entries the first entry of a name that programs use for it. Throws `InputError`.
  virtual std::vector<std::uint8_t> preview(const Container& archive) const;
};

/// All formats, in the order in which they are tried.
const std::vector<const ArchiveFormat*>& all_archive_formats();
/// Throws `InputError` naming the formats when none recognises the archive, or when it is one that
/// is known and can't be read as a plain stack.
const ArchiveFormat& recognise_format(const Container& archive);
/// The format of this name; when `name` is empty, that of the ending of `path`, and where several
/// have this ending, `like` if it is one of them. Throws `InputError` naming the choices.
const ArchiveFormat& format_named(const std::string& name, const std::string& path,
                                  const std::string& like = {});

// Helpers that formats share.

/// Entries whose names are PREFIX, digits, SUFFIX ("part00012.png"); by their number.
struct NumberedEntry {
  long number = 0;
  const Container::Entry* entry = nullptr;
};
std::vector<NumberedEntry> numbered_entries(const Container& archive, std::string_view prefix,
                                            std::string_view suffix);
/// Their names when the numbers are `first`, first + 1, ... without a gap; throws `InputError`
/// naming the first that is missing, or that there are none.
std::vector<std::string> complete_names(const Container& archive,
                                        const std::vector<NumberedEntry>& entries, long first,
                                        std::string_view what);

struct ImageSize {
  int width_px = 0, height_px = 0;
  int channels = 1;
};
/// Size of a PNG, from its header alone.
ImageSize image_size(const Container& archive, const std::string& name);

/// What the archive says, with our block where its format has no place for it, checked (see
/// `check_block`).
ArchiveContents read_contents(const Container& archive);

}  // namespace slicecorr::detail
namespace slicecorr {
/// Whether each of the printer's levels comes back as itself.
bool file_holds_levels(const detail::ShownGrey& shown, const Printer& printer);
}  // namespace slicecorr
namespace slicecorr::detail {

/// Our block as a file of its own, for formats that have no place for it.
inline constexpr const char* kProvenanceEntry = "slicecorr.json";

// One per file format_*.cpp.
const ArchiveFormat& uvj_format();
const ArchiveFormat& sl1_format();
const ArchiveFormat& chitubox_zip_format();
const ArchiveFormat& generic_zip_format();
const ArchiveFormat& cws_format();
const ArchiveFormat& rgb_cws_format();
const ArchiveFormat& nanodlp_format();
const ArchiveFormat& rgb_nanodlp_format();
const ArchiveFormat& vdt_format();
const ArchiveFormat& vda_format();
const ArchiveFormat& ember_zip_format();
const ArchiveFormat& ember_tar_format();
const ArchiveFormat& folder_format();
const ArchiveFormat& ctb_format();
const ArchiveFormat& photon_format();
const ArchiveFormat& goo_format();
const ArchiveFormat& photon_workshop_format();
const ArchiveFormat& anycubic_zip_format();
const ArchiveFormat& phz_format();
const ArchiveFormat& fdg_format();
const ArchiveFormat& cxdlp_format();
const ArchiveFormat& lgs_format();

}  // namespace slicecorr::detail
