// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A print with beams: one exposure of images on several displays, with the programs over real sockets.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "beams_parts.hpp"
#include "bridge_fixture.hpp"
#include "slicecorr/bridge/beam_frames.hpp"
#include "slicecorr/bridge/beam_plan.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;

/// A display that keeps what it was given.
class KeptSink final : public bridge::FrameSink {
 public:
  KeptSink(std::vector<std::shared_ptr<const bridge::Frame>>& kept, double late_s)
      : kept_(kept), late_s_(late_s) {}
  bridge::Shown show(const std::shared_ptr<const bridge::Frame>& frame, double at_s) override {
    kept_.push_back(frame);
    return {frame ? frame->number : bridge::kBlackFrame, at_s + late_s_, ++count_, {}};
  }
  void black() noexcept override { kept_.push_back(nullptr); }
  std::string describe() const override { return "kept"; }

 private:
  std::vector<std::shared_ptr<const bridge::Frame>>& kept_;
  const double late_s_;
  std::int64_t count_ = 0;
};

class BridgeBeams : public BridgePrograms {
 protected:
  /// The shipped vat, smaller, with two beams on one display and one on another.
  std::string make_vat(const std::string& name,
                       const std::vector<std::pair<std::string, std::string>>& changes = {}) {
    std::string text = text_of(std::string(SLICECORR_PRINTERS_DIR) + "/model-beam-vat.toml");
    std::vector<std::pair<std::string, std::string>> all{
        {"width_px = 480", "width_px = 96"},
        {"height_px = 480", "height_px = 64"},
        {"pixel_um = 25.0", "pixel_um = 100.0"},
        {"vat_mm = [10.0, 10.0, 10.0]", "vat_mm = [1.4, 1.4, 1.4]"},
        {R"(from = ["-x", "-y", "-z", "+x", "+y", "+z"])", R"(from = ["-x", "-y", "-z"])"},
        {"display = [1, 2, 3, 4, 5, 6]",
         "display = [1, 1, 2]\nmiddle_px = [[24, 32], [72, 32], [48, 32]]"},
        {"travel_mm = 40", "travel_mm = 4"},
        {"heartbeat_timeout_s = 0.3", "heartbeat_timeout_s = 3"},
        {"watchdog_s = 0.3", "watchdog_s = 3"},
        {"response_timeout_s = 0.04", "response_timeout_s = 0.7"}};
    all.insert(all.end(), changes.begin(), changes.end());
    for (const auto& [what, by] : all) text = replaced(text, what, by);
    const std::string path = folder / (name + ".toml");
    write_file(path, to_bytes(text));
    return path;
  }
  std::string make_job(const std::string& printer) {
    tomo::write_npy(folder / "part.npy", lattice_part());
    const std::string job = folder / "job.uvj";
    const RunResult r = run_program({program("slicecorr"), "beams", "--volume", folder / "part.npy",
                                     "--voxel-mm", "0.1", "--printer", printer, "--resin",
                                     "model-beam-resin", "--beams", "3", "-o", job, "--quiet"});
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return job;
  }
};

TEST_F(BridgeBeams, EachDisplayShowsItsOwnImage) {
  const tomo::BeamJob job = tomo::read_beam_job(make_job(make_vat("vat")));
  ASSERT_EQ(job.shown.displays.size(), 2U);
  std::vector<std::shared_ptr<const bridge::Frame>> first, second;
  const auto make = [&](bool both) {
    std::vector<std::unique_ptr<bridge::FrameSink>> sinks;
    sinks.push_back(std::make_unique<KeptSink>(first, 0.001));
    if (both) sinks.push_back(std::make_unique<KeptSink>(second, 0.004));
    return bridge::make_group_sink(std::move(sinks), job, job.printer);
  };
  EXPECT_THROW(make(false), InputError);
  const auto sink = make(true);
  const auto source = bridge::make_frame_source(job, job.printer);
  ASSERT_EQ(source->frames(), 1);
  // They shine together from when the last one does.
  EXPECT_EQ(sink->show(source->make(0), 2).at_s, 2.004);
  EXPECT_EQ(sink->show(nullptr, 3).number, bridge::kBlackFrame);
  ASSERT_EQ(first.size(), 2U);
  ASSERT_EQ(second.size(), 2U);
  EXPECT_EQ(first[0]->blue, job.shown.displays[0].pixels);
  EXPECT_EQ(second[0]->blue, job.shown.displays[1].pixels);
  EXPECT_FALSE(first[1]);
  EXPECT_FALSE(second[1]);
  // Two lattices beside each other, and one.
  const auto lit = [](const bridge::Frame& f) {
    return std::count_if(f.blue.begin(), f.blue.end(), [](auto v) { return v == 255; });
  };
  EXPECT_EQ(lit(*first[0]), 2 * lit(*second[0]));
}

TEST_F(BridgeBeams, PrintsOnTwoDisplays) {
  const std::string printer = make_vat("vat"), job = make_job(printer);
  const double exposure_s = tomo::read_beam_job(job).exposure_s;
  Sim machine = start_sim(printer, true), other = start_sim(printer, true);
  const RunResult r = run_program(
      print_command(job, printer, machine, true, {"--sink", other.frames, "--machine-is-clear"}));
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.err, HasSubstr("images on 2 displays at once"));
  EXPECT_EQ(machine.child->end(SIGTERM), 0);
  EXPECT_EQ(other.child->end(SIGTERM), 0);
  for (const Sim* sim : {&machine, &other}) {
    const auto events = lines_of(sim->events);
    const auto shown = std::count_if(events.begin(), events.end(),
                                     [](const auto& e) { return e["event"] == "frame 0"; });
    EXPECT_EQ(shown, 1) << sim->events;
  }
  // The machine's record: the first display's image, lit for the time of the job.
  const auto state = status(printer);
  EXPECT_EQ(state["frames_shown"], 1);
  std::ifstream log(folder / "state/model-beam-vat/frames.csv");
  std::string head, row;
  std::getline(log, head);
  std::getline(log, row);
  const auto fields = [](const std::string& line) {
    std::vector<std::string> out;
    std::stringstream in(line);
    for (std::string f; std::getline(in, f, ',');) out.push_back(f);
    return out;
  };
  const auto names = fields(head), values = fields(row);
  const auto at = std::find(names.begin(), names.end(), "exposed_s");
  ASSERT_NE(at, names.end()) << head;
  // To a cycle, and what it takes the lamp to come and go.
  EXPECT_NEAR(std::stod(values[static_cast<std::size_t>(at - names.begin())]), exposure_s, 0.025);
  EXPECT_TRUE(std::filesystem::exists(machine.shown));
}

TEST_F(BridgeBeams, RefusesWhatIsNotForThisMachine) {
  const std::string printer = make_vat("vat"), job = make_job(printer);
  const auto refused = [&](const std::string& other, std::vector<std::string> more = {}) {
    std::vector<std::string> command{program("printbridge"),
                                     "print",
                                     job,
                                     "--printer",
                                     other,
                                     "--dir",
                                     folder / "state",
                                     "--modbus",
                                     "tcp:127.0.0.1:1"};
    if (more.empty()) more = {"--sink", "null", "--sink", "null"};
    command.insert(command.end(), more.begin(), more.end());
    const RunResult r = run_program(command);
    EXPECT_EQ(r.exit_code, 2) << r.err;
    return r.err;
  };
  EXPECT_THAT(refused(printer, {"--sink", "null"}),
              HasSubstr("has images for 2 displays, and there are 1"));
  EXPECT_THAT(refused(make_vat("larger", {{"[1.4, 1.4, 1.4]", "[1.4, 1.4, 1.5]"}})),
              HasSubstr("a vat of 1.4 x 1.4 x 1.4 mm"));
  EXPECT_THAT(refused(make_vat("brighter", {{"[255, 10.0]", "[255, 12.0]"}})),
              HasSubstr("a calibration that ends at 10 mW/cm²"));
  EXPECT_THAT(refused(make_vat("moved", {{"[24, 32]", "[25, 32]"}})),
              HasSubstr("beams on other displays or places"));
  EXPECT_THAT(refused(make_vat("named", {{"name = \"model-beam-vat\"", "name = \"vat\""}})),
              HasSubstr("its name is 'model-beam-vat'"));
  EXPECT_THAT(refused(make_printer("dlp")), HasSubstr("was made for another printer"));
}

}  // namespace
}  // namespace slicecorr::test
