// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file stack.hpp
/// Slice archives: the native UVJ zip with our block and the formats of other programs, streamed
/// both ways (docs/formats.md).
///
/// A `StackReader` is immutable and thread-safe once made. A `StackWriter` is used from several
/// threads only through its encoders, each of which is for one thread at a time. All else is plain
/// values and thread-safe functions. What can't be read or does not fit throws `InputError`, a
/// failing disk `DeviceError`, a cancelled `context` `Cancelled`; calls that a caller could have
/// known to be wrong throw `std::invalid_argument` or `std::out_of_range`.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slicecorr/orientation.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

/// What the images of a stack show.
enum class StackKind {
  foreign,    ///< made by another program: grey values, meaning unknown
  target,     ///< made by `slice`: coverage, 255 is full
  corrected,  ///< made by `correct`: grey levels of a printer
  recorded,   ///< what a machine really showed, image by image (recording.hpp)
};

/// Names of the settings that a slicer wrote into its archive; empty where it did not.
struct ArchiveProfiles {
  std::string printer;   ///< of the printer's settings, else its model
  std::string material;  ///< of the resin
  std::string print;     ///< of the slicing
};

/// One exposure of a layer that has several: an image of the archive.
struct LayerExposure {
  int layer = 0;
  double time_s = 0;       ///< light-on time
  double light_share = 1;  ///< share of full light, 0..1
  /// It shows a pixel or none: printers are given such an image to wait. It stays as it is.
  bool spot = false;
  bool operator==(const LayerExposure&) const = default;
};

/// All that a stack says about itself besides its images. Holds no clock time, host, path or thread
/// count: the same input gives the same bytes.
struct StackInfo {
  std::string format;  ///< name of the archive's format, "uvj"
  /// Pixel sizes and the layer height are 0 where an archive does not say them.
  Grid grid;
  Orientation orientation;
  bool orientation_known = false;  ///< whether the archive says so, or it is a stack of ours
  /// The images are those that the display shows; else those of the plate, which are turned on
  /// their way to it by the printer's orientation.
  bool for_display = false;
  ArchiveProfiles profiles;
  StackKind kind = StackKind::foreign;
  /// Full parameters, present in stacks made by `correct` and in recorded ones.
  std::optional<Printer> printer;
  std::optional<Resin> resin;
  std::optional<Process> process;
  /// Which image was lit in which slice; null but in recorded stacks, where `grid.layers` is the
  /// number of images.
  std::shared_ptr<const Recording> recording;
  /// Of targets of ours: whether the archive holds edge heights (target.hpp).
  bool has_edge_heights = false;
  int target_layers = 0;       ///< layers of the part; grid.layers has the added slices too
  double part_volume_mm3 = 0;  ///< volume of the target's coverage, >= 0; 0 when not known
  std::string program;         ///< name and version of the program that wrote it
  /// Of stacks of ours that were read: their parameters have a checksum, and it is right. Those of
  /// earlier versions have none; those whose checksum is wrong are not read at all.
  bool parameters_checked = false;
  /// SHA-256 of the archive that was corrected, 64 hex digits; empty when it was not noted.
  std::string original_sha256;
  /// Light-on time of normal layers, s; 0 when the archive has none.
  double exposure_s = 0;
  /// Light-on time of the first `bottom_layers`, s; 0 when the archive says nothing of them.
  double bottom_exposure_s = 0;
  int bottom_layers = 0;  ///< layers, >= 0
  int fade_layers = 0;    ///< layers after them that lead to the normal time, see Process
  /// Light-on time of each layer, s, when the archive lists them and they are not all `exposure_s`.
  std::vector<double> layer_exposure_s;
  /// Share of full light that each layer gets, above 0 and at most 1; the last holds for later layers;
  /// empty: all of it.
  std::vector<double> light_share;
  /// Height of each layer, um, where they are not all `grid.layer_um`; the last holds for later layers.
  std::vector<double> layer_heights_um;
  /// Where some layers are exposed more than once: every exposure of the archive, in its order.
  std::vector<LayerExposure> exposures;
  /// How the platform lifts between layers, where the archive says it.
  std::optional<LiftTimes> lift_times{};
  /// Time of the print that the archive says itself, s; 0 when it says none.
  double own_print_time_s = 0;
  /// Height to which the machine builds, mm, as the archive says it; 0 when it does not. Of stacks with a
  /// printer that is its `travel_mm` where nothing else was told.
  double machine_height_mm = 0;
  /// As `ImageFrame::made_for`; of archives of other programs nobody knows it.
  Shrinkage made_for{};
};

/// Height of a layer, um.
double layer_height_um(const StackInfo& info, int layer);
/// Height of the first `layers` layers together, um.
double stack_height_um(const StackInfo& info, int layers);
/// How the images of a stack lie, by what it says.
ImageFrame image_frame(const StackInfo& info);
/// The process of a corrected stack; else one, layer by layer, that has the archive's times.
Process process_of_times(const StackInfo& info);
/// Time in which all slices of the stack are shown, s: by its process when corrected, else by the
/// archive's times, 0 when it has none. Without what lies between slices layer by layer. Of a
/// recorded stack the time of full light that gives as much.
double light_on_s(const StackInfo& info);
/// How the platform lifts between layers: as the archive says, else its printer; nothing: not known.
std::optional<LiftTimes> lift_times_of(const StackInfo& info);
/// How long a print takes: that time with what lies between layers, in continuous exposure with slices at speeds of
/// their own. Of a recording how long its images were lit, at the speeds that were measured: what was dark between is not
/// known.
PrintTime print_time(const StackInfo& info);
/// "1 h 10 min, of it 20 min of light"; of a recording "20 min with light, as recorded: nobody has timed what was dark
/// between".
std::string print_time_in_words(const StackInfo& info);

/// Grey picture, 8 bit, row by row.
struct GreyImage {
  int width_px = 0, height_px = 0;
  std::vector<std::uint8_t> pixels;
};

/// What a program can be told about an archive that the archive does not say itself.
struct MissingFacts {
  double pixel_x_um = 0, pixel_y_um = 0, layer_um = 0;  ///< 0: not told
};

/// A format of archives.
struct FormatInfo {
  std::string name, what;            ///< "sl1"; "Prusa SL1 and SL1S"
  std::vector<std::string> endings;  ///< of file names, ".sl1"; the usual one first
  bool codes_layers = false;         ///< a print file: its layers are no PNG images
};
/// All formats, in the order in which they are tried.
std::vector<FormatInfo> archive_formats();

/// An archive of any known format opened for reading. Each image is decoded once, in parallel, and
/// kept run-length coded; `read_band` is served from there.
///
/// The constructor checks the list of entries and what they say, then decodes all images. Throws
/// `InputError` on anything damaged, missing, doubled, misnamed, wrongly sized or absurdly large,
/// and when neither the archive nor `missing` says how large pixels and layers are.
class StackReader final : public SliceSource {
 public:
  /// Scratch, when needed, goes to `scratch_folder`.
  StackReader(const std::string& path, const std::string& scratch_folder,
              const ExecutionContext& context = {}, const MissingFacts& missing = {});
  ~StackReader() override;
  const StackInfo& info() const;
  const Grid& grid() const override;
  PixelBox bounds() const override;
  ImageFrame frame() const override;
  const Recording* recording() const override;
  LayerHeights heights() const override;
  void read_band(const PixelBox& band, const Sink& sink) const override;
  /// The whole image of one slice, row by row, into width_px * height_px bytes. Throws
  /// `std::out_of_range` when there is no such slice.
  void read_slice(int slice, std::uint8_t* pixels) const;
  /// Whether there is a second image per slice, for a patterned UV lamp, and that image.
  bool has_uv_images() const;
  void read_uv_slice(int slice, std::uint8_t* pixels) const;
  /// Whether the stack's block has checksums of images, as that of every stack of ours does; and
  /// whether the images (UV images) contradict them. UV images without a checksum count as changed.
  bool has_checksums() const;
  bool images_changed() const;
  bool uv_images_changed() const;
  /// The edge heights of a target of ours that has some, else null; and whether they contradict
  /// their checksum.
  const SliceSource* edge_heights() const override;
  bool edge_heights_changed() const;
  /// Where layers are exposed more than once (`StackInfo::exposures`): the archive's images with which of
  /// them each layer shows (recording.hpp), light counted with the exponent `m` of a resin, for whoever
  /// predicts. Null elsewhere. Lives as long as the reader. As a source of slices the reader has one image
  /// per layer: of each pixel the brightest of its exposures, without spots.
  std::unique_ptr<const SliceSource> exposures(double m) const;
  /// First layer whose exposures show different images, spots left out; -1: none.
  int several_images_layer() const;
  /// Sum of all pixel values.
  std::uint64_t pixel_sum() const;
  /// Names of the entries that are no slices, sorted.
  const std::vector<std::string>& other_entries() const;

  /// Only the metadata, without decoding images. Sizes that the archive does not say stay 0. Throws
  /// `InputError` as the constructor, for what is looked at.
  static StackInfo read_info(const std::string& path);

 private:
  class EdgeHeights;
  class Exposures;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Into what archive a stack is written.
struct StackFile {
  StackFile(std::string file_path) : path(std::move(file_path)) {}  // NOLINT: a path will do
  StackFile(const char* file_path) : path(file_path) {}             // NOLINT: the same
  std::string path;
  std::string format;  ///< a name of `archive_formats`; empty: by the ending of `path`
  /// An archive of the same format: its other entries, their names, order, times and comments, and
  /// the kind of its images are kept; its exposure times, too, where the stack's are no others.
  /// Empty: a new archive. May be `path` itself.
  std::string keep_from;
  std::string original_sha256;  ///< of a corrected stack, noted in it: see StackInfo
  /// Height to which the machine builds, mm, for formats that say it; 0: as the stack or its printer says.
  double machine_height_mm = 0;
  /// Images as small as they get, for stacks that are kept: takes many times longer. The pixels are
  /// the same.
  bool archive = false;
  /// Called when the archive is whole under its temporary name, just before it takes its own; what
  /// it throws leaves everything as it was.
  std::function<void()> before_renaming;
};
/// Name of the format that the file is written in. Where several end like this, `like` is taken
/// when it is one of them. Throws `InputError` when none is named or ends like this.
std::string format_of(const StackFile& file, const std::string& like = {});

/// Takes the images of a stack band by band, in any order and from any thread, and writes the
/// archive at the end: to a temporary file beside its path, renamed when complete. Nothing is left
/// behind when the writer is destroyed without `finish`.
class StackWriter {
 public:
  StackWriter(const StackFile& file, const Grid& grid, const ExecutionContext& context);
  ~StackWriter();
  StackWriter(const StackWriter&) = delete;
  StackWriter& operator=(const StackWriter&) = delete;

  /// A second image per slice, uv/%08d.png, made from the first: pixel value v becomes
  /// uv_of_pixel[v], outside of bands, too. To be called before the first encoder is made.
  void set_uv_pattern(const std::array<std::uint8_t, 256>& uv_of_pixel);
  /// The same where UV light goes by place, too: `rows` gets row `y` of a slice, all of its width, and
  /// makes UV light of it; a band that is black becomes `of_black`. Called from any thread.
  using UvRows = std::function<void(int slice, int y, std::span<std::uint8_t> pixels)>;
  void set_uv_pattern(std::uint8_t of_black, UvRows rows);
  /// Edge heights beside the slices (target.hpp), for encoders to put. Returns whether the archive
  /// has a place for them: if not, that is told, and what is put is dropped. To be called before
  /// the first encoder is made; of a target only.
  bool keep_edge_heights();

  /// Makes the blobs of one band: one object per worker, reused from slice to slice.
  class BandEncoder {
   public:
    /// Rows [y0, y1): whole bands of `band_rows(grid)` rows, the image's last may be shorter.
    BandEncoder(StackWriter& writer, int y0, int y1);
    ~BandEncoder();
    BandEncoder(BandEncoder&&) noexcept;
    /// Columns [x0, x1) of the band's rows in `slice`; all other pixels are 0. Null: the band is
    /// black.
    void put(int slice, int x0, int x1, const std::uint8_t* rows);
    /// The same of the edge heights at `node`, 0 to the number of slices.
    void put_edge_heights(int node, int x0, int x1, const std::uint8_t* rows);

   private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
  };

  /// Writes the archive. `info.grid.layers` may be less than the writer's grid when trailing slices
  /// are not wanted.
  void finish(const StackInfo& info, const GreyImage& preview);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// PNG of a grey picture, filter 0.
std::vector<std::uint8_t> encode_png(const GreyImage& image);

/// Decodes any PNG to 8-bit grey; colour is averaged, transparent is black. Plain grey of 8 bits or
/// 1 bit is inflated by libdeflate, or band by band by ISA-L where it is too large or damaged; all
/// other kinds are decoded by OpenImageIO. Throws `InputError` when damaged or not of the expected
/// size. `file` and `what` name the archive and the image in messages.
GreyImage decode_png(const std::vector<std::uint8_t>& png, int expected_width_px,
                     int expected_height_px, const std::string& file, const std::string& what);

}  // namespace slicecorr
