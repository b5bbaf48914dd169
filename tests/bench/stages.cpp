// Throughput of each stage beside a limit of the machine, measured in the same run. Not timed
// asserts: numbers to read.
#include <benchmark/benchmark.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>

#include "lattice.hpp"
#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/slice.hpp"

namespace {

using namespace slicecorr;

constexpr double kLayerUm = 50;

Printer wide_printer() {
  Printer p = test::linear_printer(1, 100);
  p.width_px = 1280;
  p.height_px = 800;
  return p;
}

Setup setup() { return {wide_printer(), test::resin(230, 1500), test::process(800)}; }

const MeshSlices& target() {
  static const MeshSlices slices(test::lattice(11, 7, 6, 5, 0.4), wide_printer(), SliceOptions{});
  return slices;
}

double voxels(const Grid& g) { return static_cast<double>(g.width_px) * g.height_px * g.layers; }

void count(benchmark::State& state, double voxels_per_round) {
  state.counters["Mvoxel/s"] =
      benchmark::Counter(voxels_per_round * static_cast<double>(state.iterations()) / 1e6,
                         benchmark::Counter::kIsRate);
}

/// The limit: copying a byte per voxel.
void copy(benchmark::State& state) {
  std::vector<char> from(64 << 20, 1), to(64 << 20);
  for (auto _ : state) {
    std::memcpy(to.data(), from.data(), from.size());
    benchmark::DoNotOptimize(to.data());
  }
  count(state, 64 << 20);
}
BENCHMARK(copy);

/// Slicing alone: every band of the part's box, nothing kept.
void slice(benchmark::State& state) {
  const MeshSlices& t = target();
  for (auto _ : state) {
    const PixelBox box = t.bounds();
    std::uint64_t lit = 0;
    const int rows = band_rows(t.grid());
    for (int y = box.y0 / rows * rows; y < box.y1; y += rows) {
      t.read_band({box.x0, y, box.x1, std::min(y + rows, t.grid().height_px)},
                  [&](int, const std::uint8_t* r) { lit += r != nullptr; });
    }
    if (lit == 0) throw Error("the lattice was not sliced");
  }
  count(state, voxels(t.grid()));
}
BENCHMARK(slice)->Unit(benchmark::kMillisecond);

Setup layerwise_setup() {
  Setup s{wide_printer(), test::resin(576, 110), Process{}};
  s.process.mode = ExposureMode::layerwise;
  s.process.exposure_s = 0.16;
  return s;
}

/// The solve of one band, coverage at hand.
void correct_with(benchmark::State& state, const Setup& how) {
  const CorrectionPlan plan = plan_correction(target(), how);
  const PixelBox box = target().bounds();
  const int rows = band_rows(target().grid());
  const int y = (box.y0 + box.y1) / 2 / rows * rows;
  const PixelBox band{box.x0, y, box.x1, y + rows};
  const auto columns =
      static_cast<std::size_t>(band.width()) * static_cast<std::size_t>(band.height());
  for (auto _ : state) {
    BandCorrector corrector(plan, columns);
    target().read_band(band, [&](int, const std::uint8_t* r) { corrector.add_layer(r); });
    int sum = 0;
    corrector.solve([&](int, const std::uint8_t* l, const std::uint8_t*, bool) { sum += l[0]; });
    benchmark::DoNotOptimize(sum);
  }
  count(state, static_cast<double>(columns) * plan.all_layers);
}
void correct(benchmark::State& state) { correct_with(state, setup()); }
BENCHMARK(correct)->Unit(benchmark::kMillisecond);
void correct_layerwise(benchmark::State& state) { correct_with(state, layerwise_setup()); }
BENCHMARK(correct_layerwise)->Unit(benchmark::kMillisecond);

/// The prediction of one band of the target shown as it is, both at hand.
void predict_with(benchmark::State& state, const Setup& how) {
  const CureModel model = make_cure_model(how.printer, how.resin, how.process, kLayerUm);
  const PixelCurve curve = pixel_curve(model);
  const PixelBox box = target().bounds();
  const int rows = band_rows(target().grid());
  const int y = (box.y0 + box.y1) / 2 / rows * rows;
  const PixelBox band{box.x0, y, box.x1, y + rows};
  const auto columns =
      static_cast<std::size_t>(band.width()) * static_cast<std::size_t>(band.height());
  std::vector<std::vector<std::uint8_t>> slices;
  target().read_band(band, [&](int, const std::uint8_t* r) {
    slices.emplace_back(r ? r : nullptr, r ? r + columns : nullptr);
    slices.back().resize(columns);
  });
  for (auto _ : state) {
    BandPredictor predictor(model, curve, static_cast<int>(slices.size()), columns);
    for (std::size_t n = slices.size(); n-- > 0;) {
      predictor.add_slice(static_cast<int>(n), slices[n].data(), slices[n].data());
    }
    benchmark::DoNotOptimize(predictor.finish(0, 0, band.width()));
  }
  count(state, static_cast<double>(columns * slices.size()));
}
void predict(benchmark::State& state) { predict_with(state, setup()); }
BENCHMARK(predict)->Unit(benchmark::kMillisecond);
void predict_layerwise(benchmark::State& state) { predict_with(state, layerwise_setup()); }
BENCHMARK(predict_layerwise)->Unit(benchmark::kMillisecond);

/// The whole job: slice, correct, predict before and after, encode, write; and its proof.
void run(benchmark::State& state) {
  const auto path = std::filesystem::temp_directory_path() / "slicecorr-bench.uvj";
  Job job;
  job.threads = static_cast<int>(state.range(0));
  for (auto _ : state) {
    const Correction c = correct_stack(target(), setup(), path.string(), {.before = true}, job);
    if (c.after.cure_through_voxels || c.after.undercure_voxels) throw Error("does not verify");
  }
  std::filesystem::remove(path);
  count(state, voxels(target().grid()));
}
BENCHMARK(run)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();

/// Reading a corrected stack back and verifying it.
void verify(benchmark::State& state) {
  const auto path = std::filesystem::temp_directory_path() / "slicecorr-bench.uvj";
  correct_stack(target(), setup(), path.string(), {});
  Job job;
  job.threads = static_cast<int>(state.range(0));
  for (auto _ : state) {
    const StackReader stack(path.string(), path.parent_path().string(), job);
    const Prediction p = verify_stack(stack, target(), setup(), job);
    if (p.cure_through_voxels || p.undercure_voxels || p.target_voxels == 0) {
      throw Error("does not verify");
    }
  }
  std::filesystem::remove(path);
  count(state, voxels(target().grid()));
}
BENCHMARK(verify)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
