// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file format_times.hpp
/// Sizes and exposure times that archives of G-code printers and the like say in similar ways.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "slicecorr/lift_times.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/binary_block.hpp"

namespace slicecorr::detail {

inline constexpr int kMaxLayers = 1'000'000;

/// Millimetres to micrometres, without the noise of a division by pixels.
double um_of_mm(double mm);
/// Micrometres to millimetres, rounded to 1e-9 mm: without the noise of the last digits.
double mm_of_um(double um);

/// Takes the whole number that `value`, if any, is. Throws `InputError` naming `key` otherwise.
std::optional<int> whole(std::optional<double> value, const std::string& file,
                         const std::string& entry, const std::string& key);

/// Size of the images from the first one, whether they are RGB-packed when the archive says how
/// wide they are, and a check of both. `says` names the place that says the size.
void take_image_size(const Container& archive, std::optional<int> width_px,
                     std::optional<int> height_px, const std::string& says, bool may_be_packed,
                     ArchiveContents& contents);

/// Size of a pixel on the plate from that of the display; leaves 0 where either is not known.
/// Throws `InputError` when it is not from 1 to 1000 um.
double pixel_um(double pixel_mm, const Container& archive, const std::string& says);
/// The same for the height of a layer.
double layer_um(double layer_mm, const Container& archive, const std::string& says);

/// The height to which a machine builds, mm, as an archive says it, without the noise of its float; 0 where that is
/// no height.
double machine_height_of(double mm);
/// What a new file says of it: what is known; where nothing is, or an archive says less than the part is high,
/// `otherwise_mm` in whole mm.
double new_machine_height_mm(const StackInfo& info, double otherwise_mm);

/// Takes light-on times of all layers, s, unless the times of `info` say the same; fading layers
/// after the bottom ones are recognised.
void take_layer_times(std::vector<double> times_s, StackInfo& info);

/// Takes how bright layers are lit, each from 0 to `full`. Throws `InputError` naming the layer where one
/// is lit by more; `says` names the place. Nothing but 0 is no word of it, which is told. Of slices of
/// others `check_lit` refuses a single 0.
void take_light(const std::vector<double>& light, double full, const std::string& file,
                const std::string& says, StackInfo& info,
                std::vector<std::string>* warnings = nullptr);
/// Throws `InputError` where a layer is lit by nothing.
void check_lit(const StackInfo& info, const std::string& file);
/// Brightness of each layer in whole steps, 255 being full light. Throws `InputError` naming the file
/// where it lies between them.
struct LightSteps {
  std::vector<unsigned> layers;
  unsigned bottom = 255, usual = 255;
  bool uneven = false;  ///< layers differ in another way than the first ones from the others
};
LightSteps light_steps(const ArchiveRequest& request, const std::string& path, int bottom_layers);
/// Throws `InputError` where light of layers is to change in an archive that is changed in single places;
/// `entry` says the light.
void refuse_other_light(const ArchiveRequest& request, const std::string& entry);
/// Height of the last layer of the archive that is changed, mm: that of layers that are added.
double last_layer_mm(const ArchiveRequest& request);
/// Tells that a new file's mark is set that printers heed settings of single layers. `format`: "GOO".
void tell_own_settings(const ArchiveRequest& request, std::string_view format);
/// Tells what a head of one time for the first layers and one for all others leaves to the G-code below it.
void tell_head_times(const ArchiveRequest& request, std::string_view format);
/// Tells that times of single layers are in a file whose printers do not heed them, where they are others
/// than those that count.
void tell_unheeded_times(const std::vector<double>& times_s, const StackInfo& info,
                         std::vector<std::string>& warnings);

/// Of files of Anycubic's newer printers.
inline constexpr const char* kPrinterChoosesWords =
    "says that the printer chooses exposures by itself (intelligent mode), which may be others than those "
    "in the file; expected a file with this turned off in the slicer";

/// Ways, speeds and times of lifts that are more are none.
inline constexpr double kMostLiftNumber = 1e5;
/// A place of a binary file that says lifts.
class LiftNumbers {
 public:
  explicit LiftNumbers(const BinaryBlock& block) : block_(block) {}
  /// The number at `at`; one that is no time, way or speed makes all of them unknown.
  double at(std::size_t at);
  /// The same, from a speed in mm/min.
  double mm_s(std::size_t at) { return this->at(at) / 60; }
  bool known() const { return known_; }

 private:
  const BinaryBlock& block_;
  bool known_ = true;
};
/// The same in lines of keys and values: nothing where the key is not there, or has no such number.
std::optional<double> lift_number(const KeyValueText& text, std::string_view key);
/// Takes what an archive says of lifts, unless ways have no speed: such lifts are not known. Layers'
/// own, where all are as the bottom's and the normal one, are left out.
void take_lifts(LiftTimes lifts, StackInfo& info);

/// Names of `layers` images: the kept ones and, after them, their numbers continued with at least
/// as many digits as the last one has. Throws `InputError` when there are more kept ones.
std::vector<std::string> continued_names(const ArchiveRequest& request, std::string_view suffix);

void warn(const ArchiveRequest& request, std::string text);
/// Tells of prints that move while they cure, which these formats have no word for, and of stacks
/// that say no exposure.
void warn_of_mode(const ArchiveRequest& request, std::string_view format,
                  PrintersLift lift = PrintersLift::not_known);

/// Whether the platform is lifted between the layers of the stack.
bool lifts(const StackInfo& info);
/// Lifts that new files say, until somebody sets what the printer needs, mm and mm/min: slow enough for any, as
/// Chitubox proposes them.
inline constexpr double kLiftMm = 5, kLiftMmMin = 60, kDropMmMin = 150;
/// A motion as one stage up, one back and one rest, with the speeds that take as long.
struct OneStage {
  double mm = 0, up_mm_min = kLiftMmMin, back_mm_min = kDropMmMin, wait_s = 0;
  double dark_s() const { return 60 * mm * (1 / up_mm_min + 1 / back_mm_min) + wait_s; }
};
OneStage one_stage(const LiftMotion& motion);
/// What a new file says of lifts: as the archive does that the slices are of, else as the printer file does,
/// else the above; nothing where none are.
struct NewLift {
  enum class From { proposed, printer, archive };
  From from = From::proposed;
  /// Of each layer: without tilts and accelerations, which files don't say.
  LiftTimes times;
  /// Of a layer besides its light, as these files' programs reckon it.
  double dark_s(int layer) const { return dark_time(times.of(layer), 0).all_s(); }
  /// Whether a file whose head says one motion of the first `bottom_layers`, with the waits of all others,
  /// and one of the others must list those of layers. `waits`: the head has waits of bottom layers, too.
  bool differs_from_head(int bottom_layers, bool waits) const;
};
NewLift new_lift(const StackInfo& info);
/// Tells it. `format`: "GOO".
void tell_new_lift(const ArchiveRequest& request, std::string_view format, const NewLift& lift);
/// Tells which lifts of the archive that was read a new one of another format does not say.
void tell_lifts_left(const ArchiveRequest& request, std::string_view format);

}  // namespace slicecorr::detail
