// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tomographic printing through the C interface: arrays, operators, solving, jobs.
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>

#include "c_abi.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/tomo/print.hpp"
#include "tomo_definitions.hpp"

namespace slicecorr::test {
namespace {

using BenchHandle = std::unique_ptr<slicecorr_tomo_bench, Freer<slicecorr_tomo_bench_free>>;
using TomoJobHandle = std::unique_ptr<slicecorr_tomo_job, Freer<slicecorr_tomo_job_free>>;

template <class T>
constexpr std::int32_t type_of() {
  return std::is_same_v<T, float>    ? SLICECORR_FLOAT32
         : std::is_same_v<T, double> ? SLICECORR_FLOAT64
                                     : SLICECORR_UINT8;
}

/// Without gaps, the last axis fastest.
template <class T>
slicecorr_array array_of(T* data, std::size_t n0, std::size_t n1, std::size_t n2) {
  const auto step = [](std::size_t n) { return static_cast<std::ptrdiff_t>(n * sizeof(T)); };
  return {sizeof(slicecorr_array),
          type_of<T>(),
          0,
          const_cast<std::remove_const_t<T>*>(data),
          {n0, n1, n2},
          {step(n1 * n2), step(n2), step(1)}};
}
slicecorr_array array_of(tomo::Box<std::uint8_t>& box) {
  return array_of(box.values.data(), box.nz, box.ny, box.nx);
}

BenchHandle plain_bench(const slicecorr_tomo_grid& grid, const slicecorr_array* insert = nullptr) {
  BenchHandle bench;
  EXPECT_EQ(slicecorr_tomo_bench_create(&grid, insert, out(bench)), SLICECORR_OK)
      << slicecorr_error_text();
  return bench;
}

double bench_number(const slicecorr_tomo_bench* bench, const char* name) {
  double value = 0;
  EXPECT_EQ(slicecorr_tomo_bench_number(bench, name, &value), SLICECORR_OK)
      << slicecorr_error_text();
  return value;
}

std::vector<float> random_numbers(std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<float> numbers(count);
  for (float& v : numbers) v = static_cast<float>(random() % 4096) / 4096;
  return numbers;
}

constexpr slicecorr_tomo_grid kGrid = {sizeof(slicecorr_tomo_grid), 31, 20, 36, 0, 6.0, 0, 0.8};

// Layouts are part of the interface: programs are built with them.
TEST(CAbiTomo, StructsKeepTheirLayout) {
  EXPECT_EQ(sizeof(slicecorr_array), 8 * sizeof(size_t) + 8);
  EXPECT_EQ(offsetof(slicecorr_array, data), sizeof(size_t) + 8);
  EXPECT_EQ(offsetof(slicecorr_array, strides), 5 * sizeof(size_t) + 8);
  EXPECT_EQ(sizeof(slicecorr_tomo_grid), sizeof(size_t) + 16 + 24);
  EXPECT_EQ(offsetof(slicecorr_tomo_grid, radius_mm), sizeof(size_t) + 16);
}

TEST(CAbiTomo, NullIsABadCallThatNamesTheArgument) {
  const BenchHandle bench = plain_bench(kGrid);
  const SetupHandle setup(slicecorr_setup_new());
  slicecorr_tomo_bench* const b = bench.get();
  slicecorr_tomo_bench* made = nullptr;
  slicecorr_tomo_job* job = nullptr;
  slicecorr_figures* figures = nullptr;
  std::vector<float> numbers(20 * 36 * 31);
  std::vector<std::uint8_t> bytes(20 * 31 * 31);
  const slicecorr_array volume = array_of(numbers.data(), 20, 31, 31),
                        light = array_of(numbers.data(), 20, 36, 31),
                        part = array_of(bytes.data(), 20, 31, 31);
  double value = 0;
  const auto bad = [](slicecorr_status status, const std::string& argument) {
    EXPECT_EQ(status, SLICECORR_BAD_CALL) << argument;
    EXPECT_EQ(slicecorr_error_text(), argument + " is NULL");
  };
  bad(slicecorr_tomo_bench_create(nullptr, nullptr, &made), "grid");
  bad(slicecorr_tomo_bench_create(&kGrid, nullptr, nullptr), "bench");
  bad(slicecorr_tomo_bench_new(nullptr, 1, nullptr, &made), "setup");
  bad(slicecorr_tomo_bench_new(setup.get(), 1, nullptr, nullptr), "bench");
  bad(slicecorr_tomo_bench_number(nullptr, "voxels", &value), "bench");
  bad(slicecorr_tomo_bench_number(b, nullptr, &value), "name");
  bad(slicecorr_tomo_bench_number(b, "voxels", nullptr), "value");
  bad(slicecorr_tomo_forward(nullptr, &volume, &light, nullptr), "bench");
  bad(slicecorr_tomo_forward(b, nullptr, &light, nullptr), "volume");
  bad(slicecorr_tomo_forward(b, &volume, nullptr, nullptr), "light");
  bad(slicecorr_tomo_adjoint(nullptr, &light, &volume, nullptr), "bench");
  bad(slicecorr_tomo_adjoint(b, nullptr, &volume, nullptr), "light");
  bad(slicecorr_tomo_adjoint(b, &light, nullptr, nullptr), "volume");
  bad(slicecorr_tomo_filtered_start(nullptr, &part, nullptr, &light, nullptr), "bench");
  bad(slicecorr_tomo_filtered_start(b, nullptr, nullptr, &light, nullptr), "part");
  bad(slicecorr_tomo_filtered_start(b, &part, nullptr, nullptr, nullptr), "light");
  bad(slicecorr_tomo_solve(nullptr, nullptr, setup.get(), nullptr, &job, &figures), "part");
  bad(slicecorr_tomo_solve(&part, nullptr, nullptr, nullptr, &job, &figures), "setup");
  bad(slicecorr_tomo_solve(&part, nullptr, setup.get(), nullptr, nullptr, &figures), "tomo_job");
  bad(slicecorr_tomo_job_of_light(nullptr, nullptr, &light, 1, setup.get(), &job), "part");
  bad(slicecorr_tomo_job_of_light(&part, nullptr, nullptr, 1, setup.get(), &job), "light");
  bad(slicecorr_tomo_job_of_light(&part, nullptr, &light, 1, nullptr, &job), "setup");
  bad(slicecorr_tomo_job_of_light(&part, nullptr, &light, 1, setup.get(), nullptr), "tomo_job");
  bad(slicecorr_tomo_job_open(nullptr, nullptr, &job), "path");
  bad(slicecorr_tomo_job_open("x.frames", nullptr, nullptr), "tomo_job");
  bad(slicecorr_tomo_job_write(nullptr, "x.frames", nullptr), "tomo_job");
  bad(slicecorr_tomo_job_number(nullptr, "turns", &value), "tomo_job");
  bad(slicecorr_tomo_job_frames(nullptr, 0, &part, nullptr), "tomo_job");
  bad(slicecorr_tomo_job_light(nullptr, &light, nullptr), "tomo_job");
  bad(slicecorr_tomo_job_part(nullptr, &part, nullptr), "tomo_job");
  bad(slicecorr_tomo_job_dose(nullptr, &volume, nullptr), "tomo_job");
  bad(slicecorr_tomo_verify(nullptr, nullptr, nullptr, &figures), "tomo_job");
  bad(slicecorr_tomo_verify(nullptr, nullptr, nullptr, nullptr), "figures");
  slicecorr_tomo_bench_free(nullptr);
  slicecorr_tomo_job_free(nullptr);
  EXPECT_EQ(made, nullptr);
  EXPECT_EQ(job, nullptr);
  EXPECT_EQ(figures, nullptr);
}

TEST(CAbiTomo, WrongArraysAreRefusedByName) {
  const BenchHandle bench = plain_bench(kGrid);
  std::vector<float> v(20 * 31 * 31, 1), b(20 * 36 * 31);
  const slicecorr_array volume = array_of(v.data(), 20, 31, 31),
                        light = array_of(b.data(), 20, 36, 31);
  const auto told = [&](const slicecorr_array& from, const slicecorr_array& to,
                        slicecorr_status expected, const std::string& text) {
    EXPECT_EQ(slicecorr_tomo_forward(bench.get(), &from, &to, nullptr), expected) << text;
    EXPECT_NE(std::string(slicecorr_error_text()).find(text), std::string::npos)
        << slicecorr_error_text();
  };
  const auto with = [](slicecorr_array a, auto change) {
    change(a);
    return a;
  };
  told(volume, light, SLICECORR_OK, "");
  told(with(volume, [](auto& a) { a.struct_size = 0; }), light, SLICECORR_BAD_CALL,
       "slicecorr_array.struct_size is 0");
  told(with(volume, [](auto& a) { a.reserved = 1; }), light, SLICECORR_BAD_CALL,
       "volume.reserved is 1");
  told(with(volume, [](auto& a) { a.type = SLICECORR_UINT8; }), light, SLICECORR_BAD_CALL,
       "volume.type is 1; expected SLICECORR_FLOAT32 or SLICECORR_FLOAT64");
  told(with(volume, [](auto& a) { a.type = 0; }), light, SLICECORR_BAD_CALL, "volume.type is 0");
  told(volume, with(light, [](auto& a) { a.type = 7; }), SLICECORR_BAD_CALL, "light.type is 7");
  told(volume, with(light, [](auto& a) { a.data = nullptr; }), SLICECORR_BAD_CALL,
       "light.data is NULL");
  told(volume, with(light, [](auto& a) { a.strides[1] = 0; }), SLICECORR_BAD_CALL,
       "light is to be written, but its numbers share memory");
  told(volume, with(light, [](auto& a) { a.strides[0] = a.strides[1] * 35; }), SLICECORR_BAD_CALL,
       "light is to be written, but its numbers share memory");
  told(with(volume, [](auto& a) { a.shape[0] = 19; }), light, SLICECORR_BAD_INPUT,
       "volume has the shape (19, 31, 31); expected (20, 31, 31): slices, voxels along y, voxels "
       "along x");
  told(volume, with(light, [](auto& a) { a.shape[2] = 30; }), SLICECORR_BAD_INPUT,
       "light has the shape (20, 36, 30); expected (20, 36, 31): rows, angles, pixels");
  told(with(volume, [](auto& a) { a.shape[1] = 0; }), light, SLICECORR_BAD_INPUT,
       "volume has 20 x 0 x 31 numbers");
  // The first in the corner, where no light comes.
  v[3 * 31 * 31] = std::nanf("");
  told(volume, light, SLICECORR_BAD_INPUT, "volume[3, 0, 0] is nan; expected finite");
  v[3 * 31 * 31] = std::numeric_limits<float>::infinity();
  told(volume, light, SLICECORR_BAD_INPUT, "volume[3, 0, 0] is inf");
  std::vector<double> wide(v.size(), 1);
  wide.back() = -1e39;
  told(array_of(wide.data(), 20, 31, 31), light, SLICECORR_BAD_INPUT,
       "volume[19, 30, 30] is -1e+39");

  slicecorr_tomo_bench* made = nullptr;
  const auto no_grid = [&](auto change, slicecorr_status expected, const std::string& text) {
    slicecorr_tomo_grid grid = kGrid;
    change(grid);
    EXPECT_EQ(slicecorr_tomo_bench_create(&grid, nullptr, &made), expected) << text;
    EXPECT_NE(std::string(slicecorr_error_text()).find(text), std::string::npos)
        << slicecorr_error_text();
    EXPECT_EQ(made, nullptr);
  };
  no_grid([](auto& g) { g.struct_size = 8; }, SLICECORR_BAD_CALL, "slicecorr_tomo_grid");
  no_grid([](auto& g) { g.voxels = 1; }, SLICECORR_BAD_INPUT, "voxels");
  no_grid([](auto& g) { g.slices = 0; }, SLICECORR_BAD_INPUT, "slices");
  no_grid([](auto& g) { g.angles = 2; }, SLICECORR_BAD_INPUT, "angles");
  no_grid([](auto& g) { g.pixels = -1; }, SLICECORR_BAD_INPUT, "pixels");
  no_grid([](auto& g) { g.radius_mm = std::nan(""); }, SLICECORR_BAD_INPUT, "radius_mm");
  no_grid([](auto& g) { g.pixel_mm = -1; }, SLICECORR_BAD_INPUT, "pixel_mm");
  no_grid([](auto& g) { g.absorption_per_cm = -1; }, SLICECORR_BAD_INPUT, "alpha");
  no_grid([](auto& g) { g.absorption_per_cm = std::nan(""); }, SLICECORR_BAD_INPUT, "alpha");
}

/// Copies of numbers in another layout; the array's bytes lie from `memory` on.
struct Layout {
  const char* name;
  std::array<int, 3> order;  ///< axes from the slowest to the fastest in memory
  bool reversed;             ///< along every axis
  std::size_t gap;           ///< bytes between numbers
  std::size_t offset;        ///< from where numbers would be aligned
};
constexpr Layout kLayouts[] = {{"as it is", {0, 1, 2}, false, 0, 0},
                               {"Fortran's order", {2, 1, 0}, false, 0, 0},
                               {"angles first", {1, 0, 2}, false, 0, 0},
                               {"from the end", {0, 1, 2}, true, 0, 0},
                               {"every second, not aligned", {0, 1, 2}, false, 9, 3}};

template <class T>
slicecorr_array laid_out(const Layout& layout, const std::array<std::size_t, 3>& shape,
                         std::vector<char>& memory) {
  slicecorr_array a{sizeof a, type_of<T>(), 0, nullptr, {shape[0], shape[1], shape[2]}, {}};
  std::ptrdiff_t step = static_cast<std::ptrdiff_t>(sizeof(T) + layout.gap), first = 0;
  for (int i = 2; i >= 0; --i) {
    const int axis = layout.order[i];
    a.strides[axis] = step;
    step *= static_cast<std::ptrdiff_t>(shape[axis]);
    if (!layout.reversed) continue;
    first += a.strides[axis] * static_cast<std::ptrdiff_t>(shape[axis] - 1);
    a.strides[axis] *= -1;
  }
  memory.assign(static_cast<std::size_t>(step) + layout.offset, 0x55);
  a.data = memory.data() + layout.offset + first;
  return a;
}
template <class T>
char* place(const slicecorr_array& a, std::size_t i, std::size_t j, std::size_t k) {
  return static_cast<char*>(a.data) + static_cast<std::ptrdiff_t>(i) * a.strides[0] +
         static_cast<std::ptrdiff_t>(j) * a.strides[1] +
         static_cast<std::ptrdiff_t>(k) * a.strides[2];
}
template <class T, class Number>
void put(const slicecorr_array& a, Number number) {
  for (std::size_t i = 0; i < a.shape[0]; ++i) {
    for (std::size_t j = 0; j < a.shape[1]; ++j) {
      for (std::size_t k = 0; k < a.shape[2]; ++k) {
        const T value = number(i, j, k);
        std::memcpy(place<T>(a, i, j, k), &value, sizeof value);
      }
    }
  }
}
template <class T, class Number>
int differing(const slicecorr_array& a, Number expected) {
  int wrong = 0;
  for (std::size_t i = 0; i < a.shape[0]; ++i) {
    for (std::size_t j = 0; j < a.shape[1]; ++j) {
      for (std::size_t k = 0; k < a.shape[2]; ++k) {
        T value;
        std::memcpy(&value, place<T>(a, i, j, k), sizeof value);
        wrong += value != static_cast<T>(expected(i, j, k));
      }
    }
  }
  return wrong;
}

template <class In, class To>
void expect_library_operators(int slices, const Layout& from, const Layout& to, bool with_insert) {
  SCOPED_TRACE(std::string(from.name) + " to " + to.name);
  slicecorr_tomo_grid given = kGrid;
  given.slices = slices;
  tomo::TomoGrid grid{.voxels = 31,
                      .slices = slices,
                      .angles = 36,
                      .pixels = 31,
                      .radius_mm = 6,
                      .pixel_mm = 12.0 / 30};
  tomo::Volume opaque(grid);
  std::vector<std::uint8_t> insert(static_cast<std::size_t>(slices) * 31 * 31);
  for (int z = 0; with_insert && z < slices; ++z) {
    opaque.coverage[grid.voxel(10 + z % 3, 15, z)] = 1;
    insert[(static_cast<std::size_t>(z) * 31 + 15) * 31 + 10 + static_cast<std::size_t>(z) % 3] = 1;
  }
  const slicecorr_array insert_array =
      array_of(insert.data(), static_cast<std::size_t>(slices), 31, 31);
  const BenchHandle bench = plain_bench(given, with_insert ? &insert_array : nullptr);
  const auto projector = tomo::make_projector(
      grid, {.alpha_per_mm = 0.08},
      with_insert ? std::make_shared<tomo::Shadow>(tomo::cast_shadow(opaque)) : nullptr);

  const auto n = static_cast<std::size_t>(slices);
  const auto x = random_numbers(n * 31 * 31, 1), b = random_numbers(n * 36 * 31, 2);
  tomo::Field field(grid);
  tomo::Light light(grid);
  const auto volume_at = [](std::size_t i, std::size_t j, std::size_t k) {
    return (i * 31 + j) * 31 + k;
  };
  const auto light_at = [](std::size_t i, std::size_t j, std::size_t k) {
    return (i * 36 + j) * 31 + k;
  };
  for (int z = 0; z < slices; ++z) {
    for (int i = 0; i < 31; ++i) {
      for (int y = 0; y < 31; ++y) field.values[grid.voxel(i, y, z)] = x[volume_at(z, y, i)];
      for (int m = 0; m < 36; ++m) light.values[grid.pixel(m, i, z)] = b[light_at(z, m, i)];
    }
  }
  const tomo::Light ax = tomo::forward(*projector, {}, field);
  const tomo::Field atb = tomo::adjoint(*projector, {}, light);

  std::vector<char> in_memory, out_memory;
  slicecorr_array in = laid_out<In>(from, {n, 31, 31}, in_memory);
  put<In>(in, [&](auto... at) { return x[volume_at(at...)]; });
  slicecorr_array result = laid_out<To>(to, {n, 36, 31}, out_memory);
  ASSERT_EQ(slicecorr_tomo_forward(bench.get(), &in, &result, nullptr), SLICECORR_OK)
      << slicecorr_error_text();
  EXPECT_EQ(differing<To>(result,
                          [&](std::size_t z, std::size_t m, std::size_t i) {
                            return ax.values[grid.pixel(static_cast<int>(m), static_cast<int>(i),
                                                        static_cast<int>(z))];
                          }),
            0);
  in = laid_out<In>(from, {n, 36, 31}, in_memory);
  put<In>(in, [&](auto... at) { return b[light_at(at...)]; });
  result = laid_out<To>(to, {n, 31, 31}, out_memory);
  ASSERT_EQ(slicecorr_tomo_adjoint(bench.get(), &in, &result, nullptr), SLICECORR_OK)
      << slicecorr_error_text();
  EXPECT_EQ(differing<To>(result,
                          [&](std::size_t z, std::size_t y, std::size_t i) {
                            return atb.values[grid.voxel(static_cast<int>(i), static_cast<int>(y),
                                                         static_cast<int>(z))];
                          }),
            0);
  // Nothing beside the numbers was touched.
  if (to.gap > 0) {
    EXPECT_EQ(out_memory.front(), 0x55);
    EXPECT_EQ(out_memory.back(), 0x55);
  }
}

TEST(CAbiTomo, OperatorsAreTheLibrarysForAnyStridesAndTypes) {
  // One slice in a block; several blocks of one, of 16 and of 32, not full.
  for (const int slices : {1, 5, 13, 40}) {
    SCOPED_TRACE(slices);
    for (const Layout& layout : kLayouts) {
      expect_library_operators<float, float>(slices, layout, kLayouts[0], false);
      expect_library_operators<double, float>(slices, kLayouts[0], layout, true);
      expect_library_operators<float, double>(slices, layout, layout, false);
    }
  }
}

TEST(CAbiTomo, OneNumberMayStandForAll) {
  const BenchHandle bench = plain_bench(kGrid);
  const float one = 1;
  const slicecorr_array all{sizeof all,   SLICECORR_FLOAT32, 0, const_cast<float*>(&one),
                            {20, 36, 31}, {0, 0, 0}};
  std::vector<double> dose(20 * 31 * 31);
  const slicecorr_array volume = array_of(dose.data(), 20, 31, 31);
  ASSERT_EQ(slicecorr_tomo_adjoint(bench.get(), &all, &volume, nullptr), SLICECORR_OK)
      << slicecorr_error_text();
  // The middle lies behind 0.6 cm of resin in every direction: e^(-0.48).
  EXPECT_NEAR(dose[(7 * 31 + 15) * 31 + 15] / 36, std::exp(-0.48), 1e-6);
}

TEST(CAbiTomo, TheOperatorsAreEachOthersTranspose) {
  for (const double absorption : {0.0, 0.8}) {
    slicecorr_tomo_grid grid = kGrid;
    grid.absorption_per_cm = absorption;
    const BenchHandle bench = plain_bench(grid);
    auto x = random_numbers(20 * 31 * 31, 3), b = random_numbers(20 * 36 * 31, 4);
    std::vector<float> ax(b.size()), atb(x.size());
    const slicecorr_array xa = array_of(x.data(), 20, 31, 31), ba = array_of(b.data(), 20, 36, 31),
                          axa = array_of(ax.data(), 20, 36, 31),
                          atba = array_of(atb.data(), 20, 31, 31);
    ASSERT_EQ(slicecorr_tomo_forward(bench.get(), &xa, &axa, nullptr), SLICECORR_OK);
    ASSERT_EQ(slicecorr_tomo_adjoint(bench.get(), &ba, &atba, nullptr), SLICECORR_OK);
    double left = 0, right = 0;
    for (std::size_t i = 0; i < b.size(); ++i) left += double(ax[i]) * b[i];
    for (std::size_t i = 0; i < x.size(); ++i) right += double(x[i]) * atb[i];
    // Numbers have 2^-24 of error for each of the up to 62 terms that they are summed of, all above 0.
    EXPECT_NEAR(left / right, 1, 70 * 0x1p-24);
  }
}

/// What progress saw, and when it stops.
struct Watched {
  std::string stages;
  double last = 0;
  int stop_after = 1 << 30, calls = 0;
  static int tell(void* user, const char* stage, double fraction) {
    auto& w = *static_cast<Watched*>(user);
    if (w.stages.find(stage) == std::string::npos) w.stages += std::string(stage) + " ";
    w.last = fraction;
    return ++w.calls >= w.stop_after;
  }
};

TEST(CAbiTomo, OperatorsTellTheirProgressAndCanBeStopped) {
  slicecorr_tomo_grid grid = kGrid;
  grid.slices = 200;
  const BenchHandle bench = plain_bench(grid);
  std::vector<float> x(200 * 31 * 31, 1), b(200 * 36 * 31);
  const slicecorr_array volume = array_of(x.data(), 200, 31, 31),
                        light = array_of(b.data(), 200, 36, 31);
  Watched watched;
  const JobHandle job(slicecorr_job_new());
  slicecorr_job_set_progress(job.get(), Watched::tell, &watched);
  ASSERT_EQ(slicecorr_tomo_forward(bench.get(), &volume, &light, job.get()), SLICECORR_OK);
  EXPECT_EQ(watched.stages, "project ");
  EXPECT_EQ(watched.last, 1);
  const std::vector<float> all = b;
  for (const int threads : {1, 3}) {
    slicecorr_job_set_threads(job.get(), threads);
    std::fill(b.begin(), b.end(), 0.0F);
    ASSERT_EQ(slicecorr_tomo_forward(bench.get(), &volume, &light, job.get()), SLICECORR_OK);
    EXPECT_EQ(b, all);
  }
  watched.stop_after = 1;
  EXPECT_EQ(slicecorr_tomo_adjoint(bench.get(), &light, &volume, job.get()), SLICECORR_CANCELLED);
  EXPECT_STRNE(slicecorr_job_error_text(job.get()), "");
}

TEST(CAbiTomo, BenchesSayWhatTheyAre) {
  const BenchHandle plain = plain_bench(kGrid);
  EXPECT_EQ(bench_number(plain.get(), "pixels"), 31);
  EXPECT_EQ(bench_number(plain.get(), "pixel_mm"), 12.0 / 30);
  EXPECT_NEAR(bench_number(plain.get(), "alpha_r"), 0.48, 1e-12);
  EXPECT_TRUE(std::isnan(bench_number(plain.get(), "turn_mj_cm3")));
  double value = 0;
  EXPECT_EQ(slicecorr_tomo_bench_number(plain.get(), "colour", &value), SLICECORR_UNKNOWN_NAME);
  EXPECT_NE(std::string(slicecorr_error_text()).find("known are voxels, slices"),
            std::string::npos);

  const SetupHandle setup =
      c_setup({{"printer", SLICECORR_PRINTERS_DIR "/model-tomography-bench.toml"},
               {"resin", SLICECORR_DB_DIR "/model-tomography-resin.toml"},
               {"voxel_mm", "0.25"}});
  BenchHandle bench;
  ASSERT_EQ(slicecorr_tomo_bench_new(setup.get(), 9, nullptr, out(bench)), SLICECORR_OK)
      << slicecorr_error_text();
  EXPECT_EQ(bench_number(bench.get(), "voxels"), 101);
  EXPECT_EQ(bench_number(bench.get(), "slices"), 9);
  // 2 pi 12.5 / 0.25, rounded up.
  EXPECT_EQ(bench_number(bench.get(), "angles"), 315);
  EXPECT_EQ(bench_number(bench.get(), "reach_mm"), 12.5);
  EXPECT_NEAR(bench_number(bench.get(), "turn_s"), 14.4, 1e-12);
  EXPECT_NEAR(bench_number(bench.get(), "turn_mj_cm3"), 0.8 * 14.4 / 315, 1e-12);
  EXPECT_EQ(bench_number(bench.get(), "to_gel_mj_cm3"), 20);
  EXPECT_EQ(bench_number(bench.get(), "black_mw_cm2"), 0.002);
  EXPECT_EQ(bench_number(bench.get(), "most_mw_cm2"), 2);

  const auto refused = [&](const Settings& settings, int slices, const std::string& text) {
    const SetupHandle wrong = c_setup(settings);
    slicecorr_tomo_bench* made = nullptr;
    EXPECT_EQ(slicecorr_tomo_bench_new(wrong.get(), slices, nullptr, &made), SLICECORR_BAD_INPUT);
    EXPECT_NE(std::string(slicecorr_error_text()).find(text), std::string::npos)
        << slicecorr_error_text();
  };
  const std::string printer = SLICECORR_PRINTERS_DIR "/model-tomography-bench.toml",
                    resin = SLICECORR_DB_DIR "/model-tomography-resin.toml";
  refused({{"resin", resin}, {"voxel_mm", "0.25"}}, 1, "no printer; expected printer");
  refused({{"printer", printer}, {"voxel_mm", "0.25"}}, 1, "no resin; expected resin");
  refused({{"printer", printer}, {"resin", resin}}, 1, "expected voxel_mm");
  refused({{"printer", printer}, {"resin", resin}, {"voxel_mm", "0.25"}}, 0, "slices is 0");
  refused({{"printer", printer}, {"resin", resin}, {"voxel_mm", "0.25"}, {"angles", "2"}}, 1,
          "at least 3");
  refused({{"printer_toml", printer_toml(96, 64)}, {"resin", resin}, {"voxel_mm", "0.25"}}, 1,
          "[vial]");
}

/// A small printer of a vial in air that turns the other way, and a part.
class CAbiTomoJob : public ::testing::Test {
 protected:
  inline static const std::string kPrinter = test::bench_printer_toml(true);
  inline static const std::string kResin = test::bench_resin_toml("0.5");
  CAbiTomoJob() {
    part_ = {3, 15, 15, std::vector<std::uint8_t>(3 * 15 * 15)};
    insert_ = part_;
    for (int z = 0; z < 3; ++z) {
      for (int y = 3; y < 12; ++y) {
        for (int x = 3; x < 12 - 2 * z; ++x) part_.values[part_.at(z, y, x)] = 255;
      }
      insert_.values[insert_.at(z, 13, 13)] = 1;
    }
    placed_ = tomo::placed(part_, parse_printer(kPrinter, "printer"), 0.25);
  }
  static SetupHandle setup_with(const Settings& more = {}) {
    Settings settings = {
        {"printer_toml", kPrinter}, {"resin_toml", kResin}, {"voxel_mm", "0.25"}, {"angles", "60"}};
    settings.insert(settings.end(), more.begin(), more.end());
    return c_setup(settings);
  }
  TomoJobHandle solved(const Settings& more = {}, FiguresHandle* figures = nullptr) {
    const SetupHandle setup = setup_with(more);
    const slicecorr_array part = array_of(part_);
    TomoJobHandle job;
    FiguresHandle own;
    EXPECT_EQ(slicecorr_tomo_solve(&part, nullptr, setup.get(), nullptr, out(job),
                                   out(figures ? *figures : own)),
              SLICECORR_OK)
        << slicecorr_error_text();
    return job;
  }
  static double number(const slicecorr_tomo_job* job, const char* name) {
    double value = 0;
    EXPECT_EQ(slicecorr_tomo_job_number(job, name, &value), SLICECORR_OK);
    return value;
  }

  tomo::Box<std::uint8_t> part_, insert_, placed_;
  const TemporaryFolder folder_;
};

TEST_F(CAbiTomoJob, IsTheLibrarysByteForByte) {
  for (const bool with_insert : {false, true}) {
    const SetupHandle setup = setup_with({{"method", "osmo"}, {"iterations", "12"}});
    const Printer printer = parse_printer(kPrinter, "printer");
    const Resin resin = parse_resin(kResin, "resin");
    tomo::PrintOptions options;
    options.angles = 60;
    options.solve.method = tomo::Method::osmo;
    options.solve.steps = 12;
    if (with_insert) options.insert = tomo::placed(insert_, printer, 0.25);
    const tomo::Print print = tomo::solve_print(placed_, 0.25, printer, resin, options);
    tomo::write_job(folder_ / "cpp.frames", print.job);

    const slicecorr_array part = array_of(part_), insert = array_of(insert_);
    TomoJobHandle job;
    FiguresHandle figures;
    ASSERT_EQ(slicecorr_tomo_solve(&part, with_insert ? &insert : nullptr, setup.get(), nullptr,
                                   out(job), out(figures)),
              SLICECORR_OK)
        << slicecorr_error_text();
    ASSERT_EQ(slicecorr_tomo_job_write(job.get(), (folder_ / "c.frames").c_str(), nullptr),
              SLICECORR_OK);
    EXPECT_EQ(read_file(folder_ / "c.frames"), read_file(folder_ / "cpp.frames"));
    EXPECT_EQ(slicecorr_figures_json(figures.get()), print.figures.to_json());
    EXPECT_EQ(number(job.get(), "insert"), with_insert ? 1 : 0);

    TomoJobHandle opened;
    ASSERT_EQ(slicecorr_tomo_job_open((folder_ / "c.frames").c_str(), nullptr, out(opened)),
              SLICECORR_OK);
    ASSERT_EQ(slicecorr_tomo_job_write(opened.get(), (folder_ / "again.frames").c_str(), nullptr),
              SLICECORR_OK);
    EXPECT_EQ(read_file(folder_ / "again.frames"), read_file(folder_ / "cpp.frames"));
    FiguresHandle verified;
    ASSERT_EQ(slicecorr_tomo_verify(opened.get(), nullptr, nullptr, out(verified)), SLICECORR_OK);
    auto expected = nlohmann::json::parse(slicecorr_figures_json(figures.get()));
    auto again = nlohmann::json::parse(slicecorr_figures_json(verified.get()));
    again["contrast_bound"] = expected["contrast_bound"];
    // Who solves does not look at the middles of voxels.
    EXPECT_EQ(again["gel_below_dose"]["centres"], 0);
    again["gel_below_dose"]["centres"] = expected["gel_below_dose"]["centres"];
    EXPECT_EQ(again, expected);
    double ver = -1;
    EXPECT_EQ(slicecorr_figures_number(verified.get(), "dose_mj_cm3.to_gel", &ver), SLICECORR_OK);
    EXPECT_EQ(ver, 20);
    slicecorr_summary summary{};
    summary.struct_size = sizeof summary;
    EXPECT_EQ(slicecorr_figures_summary(verified.get(), &summary), SLICECORR_BAD_CALL);
  }
}

TEST_F(CAbiTomoJob, ShowsFramesLightPartAndDose) {
  const TomoJobHandle job = solved({{"method", "fbp"}});
  ASSERT_EQ(slicecorr_tomo_job_write(job.get(), (folder_ / "a.frames").c_str(), nullptr),
            SLICECORR_OK);
  const tomo::TomoJob expected = tomo::read_job(folder_ / "a.frames");
  const tomo::Bench bench = tomo::make_bench(expected.printer, expected.resin, expected.sampling);
  const auto n = static_cast<std::size_t>(bench.grid.voxels);
  EXPECT_EQ(number(job.get(), "voxels"), static_cast<double>(n));
  EXPECT_EQ(number(job.get(), "angles"), 60);
  EXPECT_EQ(number(job.get(), "clockwise"), 0);
  EXPECT_EQ(number(job.get(), "width_px"), 48);
  EXPECT_EQ(number(job.get(), "height_px"), 40);
  EXPECT_EQ(number(job.get(), "turns"), expected.turns);
  EXPECT_EQ(number(job.get(), "print_time_s"), expected.turns * 14.4);

  Bytes frames(60 * 40 * 48);
  slicecorr_array array = array_of(frames.data(), 60, 40, 48);
  ASSERT_EQ(slicecorr_tomo_job_frames(job.get(), 0, &array, nullptr), SLICECORR_OK)
      << slicecorr_error_text();
  for (int f = 0; f < 60; ++f) {
    const Bytes frame = tomo::frame_image(expected, bench, f).pixels;
    ASSERT_TRUE(std::equal(frame.begin(), frame.end(), frames.begin() + f * 40 * 48)) << f;
  }
  Bytes some(2 * 40 * 48);
  array = array_of(some.data(), 2, 40, 48);
  ASSERT_EQ(slicecorr_tomo_job_frames(job.get(), 58, &array, nullptr), SLICECORR_OK);
  EXPECT_TRUE(std::equal(some.begin(), some.end(), frames.end() - 2 * 40 * 48));
  for (const int first : {-1, 59, 60}) {
    EXPECT_EQ(slicecorr_tomo_job_frames(job.get(), first, &array, nullptr), SLICECORR_BAD_INPUT);
  }

  Bytes part(3 * n * n);
  array = array_of(part.data(), 3, n, n);
  ASSERT_EQ(slicecorr_tomo_job_part(job.get(), &array, nullptr), SLICECORR_OK);
  EXPECT_EQ(part, placed_.values);

  std::vector<float> dose(3 * n * n);
  array = array_of(dose.data(), 3, n, n);
  ASSERT_EQ(slicecorr_tomo_job_dose(job.get(), &array, nullptr), SLICECORR_OK);
  EXPECT_EQ(dose, tomo::dose_of(expected).values);

  // What the frames show makes the same frames again.
  const auto pixels = static_cast<std::size_t>(bench.grid.pixels);
  std::vector<double> light(3 * 60 * pixels);
  array = array_of(light.data(), 3, 60, pixels);
  ASSERT_EQ(slicecorr_tomo_job_light(job.get(), &array, nullptr), SLICECORR_OK);
  const SetupHandle setup = setup_with();
  const slicecorr_array given = array_of(part_);
  TomoJobHandle again;
  ASSERT_EQ(
      slicecorr_tomo_job_of_light(&given, nullptr, &array, expected.turns, setup.get(), out(again)),
      SLICECORR_OK)
      << slicecorr_error_text();
  std::vector<float> same(dose.size());
  slicecorr_array same_array = array_of(same.data(), 3, n, n);
  ASSERT_EQ(slicecorr_tomo_job_dose(again.get(), &same_array, nullptr), SLICECORR_OK);
  EXPECT_EQ(same, dose);

  slicecorr_tomo_job* none = nullptr;
  EXPECT_EQ(slicecorr_tomo_job_of_light(&given, nullptr, &array, 0, setup.get(), &none),
            SLICECORR_BAD_INPUT);
  array.shape[2] -= 1;
  EXPECT_EQ(slicecorr_tomo_job_of_light(&given, nullptr, &array, 1, setup.get(), &none),
            SLICECORR_BAD_INPUT);
  EXPECT_EQ(none, nullptr);
}

TEST_F(CAbiTomoJob, EveryCodeHasItsCause) {
  const slicecorr_array part = array_of(part_);
  const auto told = [&](const Settings& more, const slicecorr_array& given,
                        const slicecorr_array* insert, slicecorr_status expected,
                        const std::string& text) {
    const SetupHandle setup = setup_with(more);
    TomoJobHandle job;
    FiguresHandle figures;
    EXPECT_EQ(slicecorr_tomo_solve(&given, insert, setup.get(), nullptr, out(job), out(figures)),
              expected)
        << text;
    EXPECT_NE(std::string(slicecorr_error_text()).find(text), std::string::npos)
        << slicecorr_error_text();
    EXPECT_EQ(job, nullptr);
    EXPECT_EQ(figures, nullptr);
  };
  told({{"max_time_s", "1"}}, part, nullptr, SLICECORR_INFEASIBLE, "longer than the 1 s allowed");
  tomo::Box<std::uint8_t> wide{1, 27, 27, std::vector<std::uint8_t>(27 * 27)};
  wide.values[wide.at(0, 13, 0)] = 255;  // at 3.25 mm; light reaches 4.5 / 1.5
  told({}, array_of(wide), nullptr, SLICECORR_BAD_INPUT, "light from all directions 3.000 mm");
  tomo::Box<std::uint8_t> long_one{1, 15, 16, std::vector<std::uint8_t>(15 * 16)};
  told({}, array_of(long_one), nullptr, SLICECORR_BAD_INPUT, "as many along x as along y");
  slicecorr_array insert = array_of(insert_);
  insert.shape[0] = 2;
  told({}, part, &insert, SLICECORR_BAD_INPUT, "insert has the shape (2, 15, 15)");
  std::vector<float> floats(3 * 15 * 15);
  told({}, array_of(floats.data(), 3, 15, 15), nullptr, SLICECORR_BAD_CALL,
       "part.type is 2; expected SLICECORR_UINT8");
  tomo::Box<std::uint8_t> empty = part_;
  std::fill(empty.values.begin(), empty.values.end(), std::uint8_t{0});
  told({}, array_of(empty), nullptr, SLICECORR_BAD_INPUT, "part");
  told({{"clip_sigma", "3"}}, part, nullptr, SLICECORR_BAD_INPUT, "expected method osmo");
  told({{"resin_toml", ""}}, part, nullptr, SLICECORR_BAD_INPUT, "no resin");

  const SetupHandle setup(slicecorr_setup_new());
  EXPECT_EQ(slicecorr_setup_set_text(setup.get(), "method", "guess"), SLICECORR_BAD_INPUT);
  EXPECT_STREQ(slicecorr_error_text(), "method is 'guess'; expected ladder, osmo, kelly, fbp");
  EXPECT_EQ(slicecorr_setup_set_text(setup.get(), "window", "hann"), SLICECORR_BAD_INPUT);
  EXPECT_EQ(slicecorr_setup_set_text(setup.get(), "beyond_reach", "yes"), SLICECORR_BAD_INPUT);
  EXPECT_EQ(slicecorr_setup_set_number(setup.get(), "voxel_mm", 0), SLICECORR_BAD_INPUT);
  EXPECT_EQ(slicecorr_setup_set_number(setup.get(), "angles", 2.5), SLICECORR_BAD_INPUT);

  slicecorr_tomo_job* none = nullptr;
  EXPECT_EQ(slicecorr_tomo_job_open((folder_ / "none.frames").c_str(), nullptr, &none),
            SLICECORR_BAD_INPUT);
  const TomoJobHandle job = solved({{"method", "fbp"}});
  EXPECT_EQ(slicecorr_tomo_job_write(job.get(), "/no/such/folder/a.frames", nullptr),
            SLICECORR_DEVICE);
  EXPECT_EQ(slicecorr_tomo_job_write(job.get(), "", nullptr), SLICECORR_BAD_INPUT);
  EXPECT_EQ(folder_.count(), 0);
  double value = 0;
  EXPECT_EQ(slicecorr_tomo_job_number(job.get(), "colour", &value), SLICECORR_UNKNOWN_NAME);
  FiguresHandle figures;
  slicecorr_array two = array_of(part_);
  two.shape[0] = 2;
  EXPECT_EQ(slicecorr_tomo_verify(job.get(), &two, nullptr, out(figures)), SLICECORR_BAD_INPUT);
  EXPECT_STREQ(slicecorr_error_text(), "part has 2 slices, the job 3; expected as many");
}

TEST_F(CAbiTomoJob, SolvingIsToldAndStopped) {
  const SetupHandle setup = setup_with();
  const slicecorr_array part = array_of(part_);
  const JobHandle job(slicecorr_job_new());
  slicecorr_job_set_notice(
      job.get(),
      [](void* user, const char*) { slicecorr_job_cancel(static_cast<slicecorr_job*>(user)); },
      job.get());
  TomoJobHandle made;
  FiguresHandle figures;
  EXPECT_EQ(slicecorr_tomo_solve(&part, nullptr, setup.get(), job.get(), out(made), out(figures)),
            SLICECORR_CANCELLED);
  EXPECT_EQ(made, nullptr);
  EXPECT_EQ(figures, nullptr);
}

TEST_F(CAbiTomoJob, ListsNameWhatThereIs) {
  const auto names = [](const char* kind) {
    ListHandle list;
    EXPECT_EQ(slicecorr_list_new(kind, out(list)), SLICECORR_OK);
    std::vector<std::string> all;
    for (size_t i = 0; i < slicecorr_list_count(list.get()); ++i) {
      all.emplace_back(slicecorr_list_name(list.get(), i));
    }
    return all;
  };
  const TomoJobHandle job = solved({{"method", "fbp"}});
  for (const std::string& name : names("tomo_property")) number(job.get(), name.c_str());
  const BenchHandle bench = plain_bench(kGrid);
  for (const std::string& name : names("bench_property")) bench_number(bench.get(), name.c_str());
  FiguresHandle figures;
  ASSERT_EQ(slicecorr_tomo_verify(job.get(), nullptr, nullptr, out(figures)), SLICECORR_OK);
  const auto known = names("tomo_figure");
  EXPECT_GT(known.size(), 15U);
  for (const std::string& name : known) {
    double value = 0;
    EXPECT_EQ(slicecorr_figures_number(figures.get(), name.c_str(), &value), SLICECORR_OK) << name;
  }
}

}  // namespace
}  // namespace slicecorr::test
