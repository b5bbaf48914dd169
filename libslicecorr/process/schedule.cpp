// What is shown for how long.

#include <algorithm>
#include <cmath>

#include "slicecorr/process.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

double layer_exposure_s(const Process& process, int layer) {
  if (!process.layer_exposure_s.empty()) {
    const auto last = static_cast<int>(process.layer_exposure_s.size()) - 1;
    return process.layer_exposure_s[static_cast<std::size_t>(std::clamp(layer, 0, last))];
  }
  const double bottom =
      process.bottom_exposure_s > 0 ? process.bottom_exposure_s : process.exposure_s;
  if (layer < process.bottom_layers) return bottom;
  const int faded = layer - process.bottom_layers + 1;
  if (faded > process.fade_layers) return process.exposure_s;
  return bottom + (process.exposure_s - bottom) * faded / (process.fade_layers + 1);
}

SliceLight slice_light(const Process& process, double m, double layer_um, int slice, int slices) {
  if (process.mode == ExposureMode::layerwise) return {layer_exposure_s(process, slice), 1.0};
  const double time_s = units::slice_time_s(layer_um, process.speed_mm_h);
  if (process.ramp != Ramp::lamp_follows || !(process.ramp_mm > 0)) return {time_s, 1.0};
  const double from_end = std::min(slice, slices - 1 - slice) + 0.5;
  const double z_mm = from_end * layer_um * 1e-3;
  if (z_mm >= process.ramp_mm) return {time_s, 1.0};
  const double speed = std::sqrt(z_mm / process.ramp_mm);
  return {time_s / speed, m == 1.0 ? speed : std::pow(speed, 1.0 / m)};
}

double light_on_s(const Process& process, double m, double layer_um, int slices) {
  if (process.mode == ExposureMode::continuous && process.ramp != Ramp::lamp_follows) {
    return slices * units::slice_time_s(layer_um, process.speed_mm_h);
  }
  double sum = 0;
  for (int n = 0; n < slices; ++n) sum += slice_light(process, m, layer_um, n, slices).time_s;
  return sum;
}

}  // namespace slicecorr
