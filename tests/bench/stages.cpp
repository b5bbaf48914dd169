// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Throughput of each stage with one thread and two, beside a limit of the machine measured in the
// same run: copying a byte per voxel ("of_copy", with as many threads). Not timed asserts: numbers
// to read; but what did not load or does not verify is an error.
//
// Whole stages are counted in voxels of the display, `solve`, `solve_layerwise` and `predict` in
// voxels of the bands they work on.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <map>

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

Setup layerwise_setup() {
  Setup s{wide_printer(), test::resin(576, 110), Process{}};
  s.process.mode = ExposureMode::layerwise;
  s.process.exposure_s = 0.16;
  return s;
}

/// A lattice that fills the display: all edges, the worst case.
const MeshSlices& target(bool antialias = true) {
  const auto sliced = [](bool on) {
    SliceOptions options;
    options.antialias = on;
    options.edge_heights = true;
    return MeshSlices(test::lattice(11, 7, 6, 5, 0.4), wide_printer(), options);
  };
  static const MeshSlices coverage = sliced(true), centres = sliced(false);
  return antialias ? coverage : centres;
}

double voxels(const Grid& g) { return static_cast<double>(g.width_px) * g.height_px * g.layers; }

ExecutionContext job_of(const benchmark::State& state) {
  ExecutionContext context;
  context.threads = static_cast<int>(state.range(0));
  return context;
}

/// The limit: every thread copies a part of more memory than caches hold.
void copy_bytes(const ExecutionContext& context, const std::vector<char>& from,
                std::vector<char>& to) {
  const auto parts = static_cast<std::size_t>(context.threads);
  const std::size_t size = from.size() / parts;
  parallel_for(context, "copy", parts, [&](std::size_t i) {
    std::memcpy(to.data() + i * size, from.data() + i * size, size);
  });
}

double copied_per_s(int threads) {
  static std::map<int, double> known;
  const auto [entry, added] = known.try_emplace(threads, 0);
  if (!added) return entry->second;
  const std::vector<char> from(64 << 20, 1);
  std::vector<char> to(from.size());
  ExecutionContext context;
  context.threads = threads;
  std::vector<double> seconds;
  for (int k = 0; k < 16; ++k) {
    const auto start = std::chrono::steady_clock::now();
    copy_bytes(context, from, to);
    seconds.push_back(
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  // The first rounds bring in the memory.
  std::nth_element(seconds.begin() + 2, seconds.begin() + 9, seconds.end());
  return entry->second = static_cast<double>(from.size()) / seconds[9];
}

void count(benchmark::State& state, double voxels_per_round) {
  const double all = voxels_per_round * static_cast<double>(state.iterations());
  state.counters["Mvoxel/s"] = benchmark::Counter(all / 1e6, benchmark::Counter::kIsRate);
  state.counters["of_copy"] = benchmark::Counter(
      all / copied_per_s(static_cast<int>(state.range(0))), benchmark::Counter::kIsRate);
}

/// All stages: one thread and two; the clock on the wall counts.
void threads(benchmark::internal::Benchmark* b) {
  b->ArgName("threads")->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();
}

void copy(benchmark::State& state) {
  const ExecutionContext context = job_of(state);
  const std::vector<char> from(64 << 20, 1);
  std::vector<char> to(from.size());
  for (auto _ : state) {
    copy_bytes(context, from, to);
    benchmark::DoNotOptimize(to.data());
  }
  count(state, static_cast<double>(from.size()));
}
BENCHMARK(copy)->Apply(threads);

/// Light of all voxels, band by band.
std::uint64_t light(const SliceSource& source) {
  const PixelBox box = source.bounds();
  const int rows = band_rows(source.grid());
  std::uint64_t sum = 0;
  for (int y = box.y0 / rows * rows; y < box.y1; y += rows) {
    const PixelBox band{box.x0, y, box.x1, std::min(y + rows, source.grid().height_px)};
    const std::size_t pixels =
        static_cast<std::size_t>(band.width()) * static_cast<std::size_t>(band.height());
    source.read_band(band, [&](int, const std::uint8_t* r) {
      for (std::size_t i = 0; r && i < pixels; ++i) sum += r[i];
    });
  }
  return sum;
}

/// Slicing alone: every band of the part's box, nothing kept.
void slice_with(benchmark::State& state, const SliceSource& t) {
  const PixelBox box = t.bounds();
  const int rows = band_rows(t.grid());
  const int first = box.y0 / rows;
  const auto bands = static_cast<std::size_t>((box.y1 + rows - 1) / rows - first);
  const ExecutionContext context = job_of(state);
  for (auto _ : state) {
    std::atomic<std::uint64_t> lit = 0;
    parallel_for(context, "slice", bands, [&](std::size_t i) {
      const int y = (first + static_cast<int>(i)) * rows;
      std::uint64_t here = 0;
      t.read_band({box.x0, y, box.x1, std::min(y + rows, t.grid().height_px)},
                  [&](int, const std::uint8_t* r) { here += r != nullptr; });
      lit += here;
    });
    if (lit == 0) throw Error("the lattice was not sliced");
  }
  count(state, voxels(t.grid()));
}
void slice(benchmark::State& state) { slice_with(state, target()); }
BENCHMARK(slice)->Apply(threads);
void slice_centres(benchmark::State& state) { slice_with(state, target(false)); }
BENCHMARK(slice_centres)->Apply(threads);
void edge_heights(benchmark::State& state) { slice_with(state, *target().edge_heights()); }
BENCHMARK(edge_heights)->Apply(threads);

/// Some bands from the middle of the part, their coverage at hand.
struct Bands {
  PixelBox box;  ///< of the first; the others follow in y
  std::size_t columns = 0;
  std::vector<std::vector<std::vector<std::uint8_t>>> coverage;  ///< per band and slice
  double voxels() const {
    return static_cast<double>(columns * coverage.size() * coverage[0].size());
  }
};
const Bands& bands() {
  static const Bands found = [] {
    constexpr int bands = 8;
    Bands b;
    const PixelBox all = target().bounds();
    const int rows = band_rows(target().grid());
    const int y = ((all.y0 + all.y1) / 2 / rows - bands / 2) * rows;
    b.box = {all.x0, y, all.x1, y + rows};
    b.columns = static_cast<std::size_t>(b.box.width()) * static_cast<std::size_t>(rows);
    for (int k = 0; k < bands; ++k) {
      auto& slices = b.coverage.emplace_back();
      target().read_band({all.x0, y + k * rows, all.x1, y + (k + 1) * rows},
                         [&](int, const std::uint8_t* r) {
                           slices.emplace_back();
                           if (r) slices.back().assign(r, r + b.columns);
                         });
    }
    return b;
  }();
  return found;
}
const std::uint8_t* rows_of(const std::vector<std::uint8_t>& slice) {
  return slice.empty() ? nullptr : slice.data();
}

/// The levels of bands whose coverage is at hand.
void solve_with(benchmark::State& state, const Setup& how) {
  const CorrectionPlan plan = plan_correction(target(), how);
  const Bands& b = bands();
  const ExecutionContext context = job_of(state);
  for (auto _ : state) {
    parallel_for(context, "solve", b.coverage.size(), [&](std::size_t i) {
      BandCorrector corrector(plan, b.columns);
      for (const auto& slice : b.coverage[i]) corrector.add_layer(rows_of(slice));
      int lit = 0;
      corrector.solve(
          [&](int, const std::uint8_t*, const std::uint8_t*, bool dark) { lit += !dark; });
      if (lit == 0) throw Error("nothing was corrected");
    });
  }
  count(state, b.voxels());
}
void solve(benchmark::State& state) { solve_with(state, setup()); }
BENCHMARK(solve)->Apply(threads);
void solve_layerwise(benchmark::State& state) { solve_with(state, layerwise_setup()); }
BENCHMARK(solve_layerwise)->Apply(threads);

/// The prediction of these bands shown as they are.
void predict_with(benchmark::State& state, const Setup& how) {
  const CureModel model = make_cure_model(how.printer, how.resin, how.process, kLayerUm);
  const PixelCurve curve = pixel_curve(model);
  const Bands& b = bands();
  const std::vector<std::uint8_t> black(b.columns);
  const ExecutionContext context = job_of(state);
  for (auto _ : state) {
    parallel_for(context, "predict", b.coverage.size(), [&](std::size_t i) {
      const auto& slices = b.coverage[i];
      BandPredictor predictor(model, curve, static_cast<int>(slices.size()), b.columns);
      for (std::size_t n = slices.size(); n-- > 0;) {
        const std::uint8_t* const rows = slices[n].empty() ? black.data() : slices[n].data();
        predictor.add_slice(static_cast<int>(n), rows, rows);
      }
      const Prediction p = predictor.finish(0, 0, b.box.width());
      if (p.target_voxels == 0 || p.printed_voxels == 0) throw Error("nothing was predicted");
    });
  }
  count(state, b.voxels());
}
void predict(benchmark::State& state) { predict_with(state, setup()); }
BENCHMARK(predict)->Apply(threads);
void predict_layerwise(benchmark::State& state) { predict_with(state, layerwise_setup()); }
BENCHMARK(predict_layerwise)->Apply(threads);

/// A stack in a file, removed at the end.
class Stack {
 public:
  explicit Stack(const char* name)
      : path_((std::filesystem::temp_directory_path() / name).string()) {}
  ~Stack() { std::filesystem::remove(path_); }
  const std::string& path() const { return path_; }
  StackReader open(const ExecutionContext& context) const {
    return {path_, std::filesystem::temp_directory_path().string(), context};
  }

 private:
  std::string path_;
};
const Stack& stored_target() {
  static const Stack stack("slicecorr-bench-target.uvj");
  static const StackInfo info = write_target(target(), stack.path());
  return stack;
}
const Stack& stored_correction() {
  static const Stack stack("slicecorr-bench-corrected.uvj");
  static const Correction done = correct_stack(target(), setup(), stack.path(), {});
  return stack;
}

/// From the file to coded bands.
void decode(benchmark::State& state) {
  const Stack& stored = stored_correction();
  const ExecutionContext context = job_of(state);
  for (auto _ : state) {
    const StackReader stack = stored.open(context);
    if (stack.grid().layers < target().grid().layers) throw Error("slices are missing");
  }
  count(state, voxels(target().grid()));
}
BENCHMARK(decode)->Apply(threads);

/// From coded bands to the file.
void encode(benchmark::State& state) {
  const StackReader stack = stored_correction().open({});
  const Stack out("slicecorr-bench.uvj");
  const ExecutionContext context = job_of(state);
  for (auto _ : state) convert_stack(stack, out.path(), context);
  if (light(out.open({})) != light(stack)) throw Error("slices did not come back as they were");
  count(state, voxels(target().grid()));
}
BENCHMARK(encode)->Apply(threads);

/// A stored stack: decode, correct, encode.
void correct(benchmark::State& state) {
  const Stack& stored = stored_target();
  const Stack out("slicecorr-bench.uvj");
  const ExecutionContext context = job_of(state);
  for (auto _ : state) {
    const StackReader stack = stored.open(context);
    const Correction c = correct_stack(stack, setup(), out.path(), {}, context);
    if (c.after.cure_through_voxels || c.after.undercure_voxels) throw Error("does not verify");
  }
  count(state, voxels(target().grid()));
}
BENCHMARK(correct)->Apply(threads);

/// The whole job: slice, correct, predict before and after, encode, write.
void run(benchmark::State& state) {
  const Stack out("slicecorr-bench.uvj");
  const ExecutionContext context = job_of(state);
  for (auto _ : state) {
    const Correction c = correct_stack(target(), setup(), out.path(), {.before = true}, context);
    if (c.after.cure_through_voxels || c.after.undercure_voxels) throw Error("does not verify");
  }
  count(state, voxels(target().grid()));
}
BENCHMARK(run)->Apply(threads);

/// Reading a corrected stack back and verifying it.
void verify(benchmark::State& state) {
  const Stack& stored = stored_correction();
  const ExecutionContext context = job_of(state);
  for (auto _ : state) {
    const StackReader stack = stored.open(context);
    const Prediction p = verify_stack(stack, target(), setup(), context);
    if (p.cure_through_voxels || p.undercure_voxels || p.target_voxels == 0) {
      throw Error("does not verify");
    }
  }
  count(state, voxels(target().grid()));
}
BENCHMARK(verify)->Apply(threads);

}  // namespace
