// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file hologram.hpp
/// Images by phase alone: what a phase-only display must show so that a lens makes wanted images of
/// it, and what light then really falls where.
///
/// The display lies in the front focal plane of a lens of focal length f and the image in the back
/// one, so that the image is the Fourier transform of the display's field e^(i s). Planes are
/// centred: index n/2 is the optical axis, rows run downwards, x to the right and y upwards.
/// Distances in the image are those behind the relay (4f, magnification f2/f1, depth (f2/f1)^2),
/// where there is one; what it turns round is turned back. Phase is in radians.
///
/// Phases are found by the iteration of R. W. Gerchberg and W. O. Saxton (Optik 35, 1972), for
/// several planes by weighted superposition. All functions are thread-safe and give the same bits
/// for any number of threads. Memory: 20 bytes per pixel of the display and plane, and 16 per pixel
/// of a padded plane that is looked at.
#pragma once

#include <complex>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/picture.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr {

/// A display that delays light, by 2 pi `stroke_turns` g / 256 at grey value g.
struct PhaseDisplay {
  int width_px = 0, height_px = 0;     ///< 2..16384
  double pitch_um = 0;                 ///< of pixels, > 0
  int levels = 256;                    ///< that it can tell apart, 2..256
  std::optional<double> stroke_turns;  ///< as measured, > 0; nothing: taken for 1, as is usual
  std::optional<double> fill;          ///< lit share of a pixel's area, 0 < fill <= 1, where known
  double front_reflection = 0.005;     ///< of its glass, 0..1
};

struct HologramOptics {
  double wavelength_nm = 0;                 ///< > 0
  double focal_mm = 0;                      ///< > 0
  double relay_f1_mm = 0, relay_f2_mm = 0;  ///< of the 4f relay behind the image; 0: none
  /// f2/f1, 1 without a relay.
  double magnification() const { return relay_f1_mm > 0 ? relay_f2_mm / relay_f1_mm : 1; }
};

/// What geometry and wavelength decide; x and y where displays are not square.
struct HologramGeometry {
  double order_deg = 0, half_field_deg = 0;  ///< of the display's grating: asin(l/d), asin(l/2d)
  double field_mm = 0;                       ///< side of all that can be reached, l f/d
  double pixel_x_mm = 0, pixel_y_mm = 0;     ///< of the image, l f/(N d)
  double aperture_x = 0, aperture_y = 0;     ///< numerical, N d/(2 f)
  double depth_of_focus_x_mm = 0, depth_of_focus_y_mm = 0;  ///< l/NA^2
  double most_shift_mm = 0, most_depth_mm = 0;              ///< that the display can sample
};

/// Throws `InputError` naming what is out of range. `file`, `place`: as errors tell it.
void check(const PhaseDisplay& display, const HologramOptics& optics);
HologramGeometry geometry_of(const PhaseDisplay& display, const HologramOptics& optics);

/// The share of the light that no phase moves from the axis, with pixels whose phases know nothing
/// of each other: what the glass reflects, what the gaps between pixels do, and what a stroke other
/// than a whole turn leaves.
double zero_order(double fill, double front_reflection, double stroke_turns);

/// The share of the light at (x, y) that pixels of this lit width still send there, 1 on the axis.
double fall_off(const PhaseDisplay& display, const HologramOptics& optics, double x_mm,
                double y_mm);

/// One image, and where it stands.
struct HologramPlane {
  std::vector<float> power;  ///< wanted, >= 0, of each pixel of the image, width_px * height_px
  double dx_mm = 0, dy_mm = 0, dz_mm = 0;  ///< of its middle; z away from the lens
  std::string name = "the target";         ///< in messages
};

/// A picture's pixels as wanted power; placed in the middle of an image of the display's size.
/// `pixel_um` is the side of the picture's pixels, which are then brought to those of the image;
/// 0: pixels are the image's own. Throws `InputError` when it is dark, lit all over, or too large.
HologramPlane plane_of_picture(const GreyImage& picture, const std::string& name,
                               const PhaseDisplay& display, const HologramOptics& optics,
                               double pixel_um = 0);

struct HologramOptions {
  int steps = 50;          ///< 1..100000
  std::uint32_t seed = 1;  ///< of the first phases
  int holograms = 1;       ///< of independent first phases, to be shown in turn; 1..1024
  /// Leaves the light beside the targets to itself: truer on target, with more light beside it.
  bool free_outside = false;
};

/// One image of phases, with the seed that it alone can be made again from.
struct PhaseImage {
  std::uint32_t seed = 0;
  std::vector<float> phase_rad;  ///< 0 <= s < 2 pi, row by row
};

/// Throws `InputError` for values out of range, planes of another size, and images moved further
/// than the display can sample; `Cancelled`. Remarks through `context.notice`: an image on the axis
/// of a display whose stroke is not known.
std::vector<PhaseImage> make_holograms(const PhaseDisplay& display, const HologramOptics& optics,
                                       const std::vector<HologramPlane>& planes,
                                       const HologramOptions& options,
                                       const ExecutionContext& context);

/// What the display shows: the nearest of its levels, level k of n as grey value 256 k/n.
GreyImage grey_of_phase(const PhaseDisplay& display, const std::vector<float>& phase_rad);
/// The phase of what is shown.
std::vector<float> phase_of_grey(const PhaseDisplay& display, const GreyImage& shown);
/// A PNG whose text says the seed, and how else it was made.
std::vector<std::uint8_t> encode_phase_png(const GreyImage& shown, const std::string& made);

/// Power in a plane `dz_mm` behind the focal plane, on `padding` times as many pixels each way
/// (of a `padding`th of the size), of light that is 1 before it falls off. By the angular spectrum, which is the display's
/// field: each of its points is a plane wave. Waves that would leave the field are left out.
std::vector<float> power_at(const PhaseDisplay& display, const HologramOptics& optics,
                            const std::vector<float>& phase_rad, double dz_mm, int padding,
                            const ExecutionContext& context);

/// A field `z_mm` further on, row by row in place; its pixels are `pitch_mm` wide. By the
/// angular spectrum, limited to the band that a window of twice the size holds (K. Matsushima and
/// T. Shimobaba, Opt. Express 17, 2009), to which the field is padded with darkness.
void propagate(std::vector<std::complex<float>>& field, int width_px, int height_px,
               double pitch_mm, double wavelength_nm, double z_mm, const ExecutionContext& context);

/// How well an image is met by phases shown in turn. Errors are RMS of power over its mean on the
/// target.
struct ImageFigures {
  double efficiency = 0;        ///< share of all light that falls on the target
  double rms_error = 0;         ///< on the image's own pixels
  double rms_error_padded = 0;  ///< looked at twice as finely, between them: speckle
  double speckle_contrast = 0;  ///< deviation over mean of power over wanted power, twice as finely
};
/// `power`, where it is not null, becomes the mean power that was looked at twice as finely, with the
/// plane's middle in its middle.
ImageFigures figures_of(const PhaseDisplay& display, const HologramOptics& optics,
                        const HologramPlane& plane,
                        const std::vector<std::vector<float>>& phases_rad,
                        const ExecutionContext& context, std::vector<float>* power = nullptr);

/// A plane as `figures_of` saw it.
struct SeenPlane {
  ImageFigures figures;
  std::vector<float> power;
};

/// Targets beside what falls into their planes, with figures in words: a file by its ending, .png
/// or .svg. Throws `InputError` for other endings. `seen`: of all planes, where they have been looked
/// at before; null: they are looked at here.
std::string hologram_picture(const PhaseDisplay& display, const HologramOptics& optics,
                             const std::vector<HologramPlane>& planes,
                             const std::vector<std::vector<float>>& phases_rad,
                             const std::string& file, const ExecutionContext& context,
                             const std::vector<SeenPlane>* seen = nullptr);

}  // namespace slicecorr
