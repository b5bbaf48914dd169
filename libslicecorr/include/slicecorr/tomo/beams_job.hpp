// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/beams_job.hpp
/// A print with beams as displays show it, and as a file.
///
/// The file is a zip with `config.json`, `display/1.png` and so on, which are all shown at once (one
/// group of frames), and `beam/00.png` and so on, the grey level of each cell's ray in the order of
/// the beams. Images of displays are as seen from the display, before what a printer's file says of
/// its orientation. `config.json` has checksums as that of `tomo/job.hpp`. The same job gives the same
/// bytes. Functions are thread-safe.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/beam_vat.hpp"
#include "slicecorr/picture.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/beams.hpp"

namespace slicecorr::tomo {

/// Newest version of `config.json` that this program reads.
inline constexpr int kBeamJobFormat = 1;

/// The way that a beam takes into a vat. Throws `InputError` when the vat has none from its side.
const BeamWay& way_of(const BeamVat& vat, const Beam& beam);

/// Where the light of an image's rays comes from, as seen from the display: columns to the right.
/// A beam's image with its first row at the top, in grey values: 255 is 1.
GreyImage seen_image(const BeamImage& image, const BeamWay& way);

/// What displays with their grey levels really make of wanted images.
struct ShownBeams {
  std::vector<GreyImage> displays;  ///< of display 1, 2 and so on; black where no beam is shown
  /// What each ray gets, in shares of the brightest light wanted: rounded to levels, black still
  /// shines. Of displays that delay light as wanted.
  std::vector<BeamImage> images;
  /// Of displays that delay light, by beam: share of the laser's light that falls on the image, its
  /// RMS error looked at twice as finely (`ImageFigures`), and the power that the beam needs, mW.
  std::vector<double> efficiency, rms_error, laser_mw;
};
/// Throws `InputError` for images larger than their display, or that overlap on it, and for light
/// that the display can't show.
ShownBeams shown_beams(const std::vector<BeamImage>& images, const BeamSetup& setup,
                       const BeamVat& vat, const Printer& printer, double brightest_mw_cm2,
                       const ExecutionContext& context = {});

struct BeamJob {
  Printer printer;
  Resin resin;
  BeamVat vat;
  BeamSetup setup;
  int cells[3] = {0, 0, 0};  ///< of the whole vat, along x, y, z
  double brightest_mw_cm2 = 0, exposure_s = 0;
  TimeWindow window;
  double contrast = 0;  ///< as shown
  ShownBeams shown;
  /// Whether the file that it was read from has checksums of what it says and shows, which then were
  /// right.
  bool has_checksums = false;
};

/// Written under a temporary name, then renamed. Throws `DeviceError`.
void write_beam_job(const std::string& path, const BeamJob& job,
                    const ExecutionContext& context = {});
/// Of `shown` the displays alone. Throws `InputError` naming entry and key for what is missing,
/// damaged, of another size than `config.json` says, or of a newer format; for an exposure outside
/// of the job's own window of time; and where `config.json`, or an image, is another than its
/// checksum says. Without checksums: a notice.
BeamJob read_beam_job(const std::string& path, const ExecutionContext& context = {});
/// Whether a file is an archive whose `config.json` says that it is such a job. Never throws for
/// other files.
bool is_beam_job(const std::string& path);

}  // namespace slicecorr::tomo
