// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file c_abi.hpp
/// What tests of the C interface share: handles that free themselves, a small printer and targets.
#pragma once

#include <gtest/gtest.h>
#include <slicecorr.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "ladder.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/slice.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {

template <auto free_handle>
struct Freer {
  template <class T>
  void operator()(T* handle) const {
    free_handle(handle);
  }
};
using SetupHandle = std::unique_ptr<slicecorr_setup, Freer<slicecorr_setup_free>>;
using JobHandle = std::unique_ptr<slicecorr_job, Freer<slicecorr_job_free>>;
using StackHandle = std::unique_ptr<slicecorr_stack, Freer<slicecorr_stack_free>>;
using FiguresHandle = std::unique_ptr<slicecorr_figures, Freer<slicecorr_figures_free>>;
using ListHandle = std::unique_ptr<slicecorr_list, Freer<slicecorr_list_free>>;

/// Where a function puts a new handle: f(..., out(handle)).
template <class Handle>
class Out {
 public:
  explicit Out(Handle& handle) : handle_(handle), raw_(handle.release()) {}
  ~Out() { handle_.reset(raw_); }
  Out(const Out&) = delete;
  Out& operator=(const Out&) = delete;
  operator typename Handle::pointer *() { return &raw_; }

 private:
  Handle& handle_;
  typename Handle::pointer raw_;
};
template <class Handle>
Out<Handle> out(Handle& handle) {
  handle.reset();
  return Out<Handle>(handle);
}

/// A printer of a few pixels, so that tests are fast; its lamp can inhibit.
inline std::string printer_toml(int width_px, int height_px, const std::string& pixel_um = "50",
                                int bit_depth = 8, const std::string& uv_kind = "flood") {
  const int top = (1 << bit_depth) - 1;
  const auto curve = [&](const char* least, const char* most) {
    return "calibration = [[0, " + std::string(least) + "], [" + std::to_string(top) + ", " + most +
           "]]\n";
  };
  return "name = \"small\"\n[display]\nwidth_px = " + std::to_string(width_px) +
         "\nheight_px = " + std::to_string(height_px) + "\npixel_um = " + pixel_um +
         "\nbit_depth = " + std::to_string(bit_depth) + "\n[blue]\n" + curve("1.0", "100.0") +
         "[uv]\nkind = \"" + uv_kind + "\"\n" + curve("0.0", "275.0") +
         "[stage]\ntravel_mm = 100\n";
}

/// What a setup is made of: names and values, as the C interface takes them.
using Settings = std::vector<std::pair<std::string, std::string>>;

inline SetupHandle c_setup(const Settings& settings) {
  SetupHandle setup(slicecorr_setup_new());
  for (const auto& [name, value] : settings) {
    EXPECT_EQ(slicecorr_setup_set_text(setup.get(), name.c_str(), value.c_str()), SLICECORR_OK)
        << slicecorr_error_text();
  }
  return setup;
}

/// The ladder on a display of 96 x 64 pixels: 50 layers with overhangs.
inline void write_ladder(const std::string& path, const std::string& printer) {
  const MeshSlices slices(ladder(), parse_printer(printer, "printer"), SliceOptions{});
  write_target(slices, path);
}

inline Settings ladder_settings(const std::string& printer) {
  return {{"printer_toml", printer},
          {"resin", SLICECORR_DB_DIR "/figure-2-2.toml"},
          {"speed_mm_h", "1000"}};
}

inline Setup ladder_setup(const std::string& printer) {
  SetupChoices choices;
  choices.printer_toml = printer;
  choices.resin = SLICECORR_DB_DIR "/figure-2-2.toml";
  choices.speed_mm_h = 1000;
  return resolve_setup(choices, nullptr, nullptr, ChoiceNames::fields);
}

inline StackHandle open_stack(const std::string& path) {
  StackHandle stack;
  EXPECT_EQ(slicecorr_stack_open(path.c_str(), out(stack)), SLICECORR_OK) << slicecorr_error_text();
  return stack;
}

inline std::string json_of(const FiguresHandle& figures) {
  return slicecorr_figures_json(figures.get());
}

/// Of figures of what uncorrected light prints, which corrections do not follow in time.
inline nlohmann::ordered_json not_in_time(const std::string& figures) {
  auto json = nlohmann::ordered_json::parse(figures);
  for (const char* key : {"in_time", "time_step_um", "islands", "islands_in_all", "verdict"}) {
    json.erase(key);
  }
  return json;
}

/// The ladder's archive, and its printer.
class CAbiLadder : public ::testing::Test {
 protected:
  CAbiLadder() { write_ladder(target_path_, printer_); }

  const TemporaryFolder folder_;
  const std::string printer_ = printer_toml(96, 64);
  const std::string target_path_ = folder_ / "target.uvj";
};

/// All slices of a stack in memory.
inline std::vector<Bytes> c_images(const slicecorr_stack* stack) {
  const auto number = [&](const char* name) {
    double value = 0;
    EXPECT_EQ(slicecorr_stack_number(stack, name, &value), SLICECORR_OK);
    return static_cast<int>(value);
  };
  const int width = number("width_px"), height = number("height_px"), layers = number("layers");
  std::vector<Bytes> images;
  for (int n = 0; n < layers; ++n) {
    images.emplace_back(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 77);
    EXPECT_EQ(slicecorr_stack_get(stack, n, images.back().data(), width), SLICECORR_OK)
        << slicecorr_error_text();
  }
  return images;
}

}  // namespace slicecorr::test
