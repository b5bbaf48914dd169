// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file layer_gcode.hpp
/// G-code that shows slices one after the other, as in archives of Chitubox and NovaMaker: read
/// layer by layer, and changed in single places.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace slicecorr::detail {

/// G-code of a million layers takes some 200 MB.
inline constexpr std::uint64_t kMaxGcodeBytes = std::uint64_t{1} << 29;

/// How a printer's G-code shows images. Light is "M106 S" in all; a layer's exposure is the sum of
/// the waits while it is on, or, where it is never switched, while the image is shown.
struct GcodeDialect {
  std::string_view show;  ///< starts a line that shows an image, whose number follows
  std::string_view wait;  ///< starts a line that waits for the milliseconds that follow
  long first = 0;         ///< number of the first layer's image
  char wait_word = 0;     ///< before the milliseconds, where there is one
};
inline constexpr GcodeDialect kChituboxGcode{"M6054", "G4", 1, 'P'};
inline constexpr GcodeDialect kCwsGcode{";<Slice>", ";<Delay>", 0, 0};

/// End of the comments at the beginning, which hold settings.
std::size_t end_of_head(std::string_view text);

class LayerGcode {
 public:
  struct Layer {
    std::size_t shown = 0;  ///< start of the line that shows its image
    long number = 0;        ///< of that image
    /// Milliseconds of its first wait in light, and where they are written.
    std::size_t wait_begin = 0, wait_end = 0;
    double wait_ms = 0, other_waits_ms = 0;
    int waits = 0;
    double light = -1;      ///< value of M106, -1 without
    double dark_ms = 0;     ///< of its waits without light, as far as they are plain numbers
    double z_mm = 0;        ///< where the platform stands while it is lit, from where it was homed
    double z_after_mm = 0;  ///< and before the next image is shown
    double exposure_s() const { return (wait_ms + other_waits_ms) / 1000; }
  };

  /// `file` and `entry` are for messages. Throws `InputError` where a wait in light is no plain
  /// decimal number of milliseconds.
  LayerGcode(std::string text, const GcodeDialect& dialect, std::string file, std::string entry);

  const std::string& text() const { return text_; }
  const std::vector<Layer>& layers() const { return layers_; }
  /// Whether it shows images `first`, `first` + 1, ... in this order, and at least as many.
  bool shows(int layers) const;
  /// Exposure of each layer, s; empty unless all of these layers have one.
  std::vector<double> exposures_s(int layers) const;
  /// Power of each layer's light, of 255; empty where none says one.
  std::vector<double> light(int layers) const;
  /// Where the platform stands for each layer, mm; empty where no line moves it. Where the first layer is
  /// lit before anything has moved, the way after a layer is that layer's.
  std::vector<double> places_mm(int layers) const;
  /// Whether exposures or layers of the text would have to be changed for these.
  bool says(int layers, const std::function<std::optional<double>(int layer)>& exposure_s) const;

  /// The text with other exposures, where `exposure_s` gives one, and with more layers, copies of
  /// the last one with their number, height and exposure. Throws `InputError` when the text has no
  /// such place.
  std::string changed(int layers, double layer_mm,
                      const std::function<std::optional<double>(int layer)>& exposure_s) const;

 private:
  struct Block {
    std::size_t begin = 0, end = 0;
    std::size_t lead = 0;  ///< lines before the one that shows the image
  };
  struct Edit;

  struct Wait {
    std::size_t begin = 0, end = 0;  ///< of the number
    double ms = 0;
  };
  void end_last(const std::vector<double>& stops_mm, std::size_t stops_before);
  [[noreturn]] void fail(const std::string& message) const;
  std::optional<Wait> wait_of(std::size_t line) const;
  std::string exposure_text(const Layer& layer, double exposure_s) const;
  std::size_t lead_lines() const;
  Block last_block() const;
  std::vector<Edit> edits_of(const Block& block, double layer_mm) const;

  std::string text_, file_, entry_;
  GcodeDialect dialect_;
  std::vector<Layer> layers_;
  bool absolute_ = true;  ///< whether the first layers' moves are to heights
  bool moves_ = false;    ///< whether any line moves the platform
};

}  // namespace slicecorr::detail
