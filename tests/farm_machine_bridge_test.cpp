// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A machine on Modbus as one of the farm's: `slicefarm machines` drives `printbridge`, which drives
// `printer-sim`.

#include <gmock/gmock.h>
#include <httplib.h>
#include <sys/stat.h>

#include "bridge_fixture.hpp"
#include "farm_fixture.hpp"
#include "farm_program.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::HasSubstr;

class BridgeMachine : public BridgePrograms {
 protected:
  /// A farm whose machine "left" is this simulator.
  void set_up(const std::string& printer, const Sim& sim) {
    const std::string state = folder / state_name;
    const auto list = [](const std::vector<std::string>& words) { return json(words).dump(); };
    std::vector<std::string> options{"--dir",  state,     "--modbus", address_of(sim.modbus),
                                     "--sink", sim.frames};
    fs::create_directories(farm());
    test::write_file(
        farm() + "/machines.toml",
        "[[machine]]\nname = \"left\"\nkind = \"bridge\"\nprinter = " + json(printer).dump() +
            "\noptions = " + list(options) + "\nstatus_options = " + list({"--dir", state}) + "\n");
  }
  std::string make_real_printer() {
    auto changes = patient();
    for (const auto& each : quick()) changes.push_back(each);
    return make_printer("real", changes);
  }
  std::string print_log() const { return text_of(farm() + "/machines/left.files/print.log"); }
  std::string farm() const { return folder / "farm"; }
  RunResult machines(const Command& arguments, const RunOptions& options = {}) const {
    return run_program(Command{kSlicefarm, "machines"} + arguments + Command{"--dir", farm()},
                       options);
  }
  json left() const {
    const RunResult r = machines({"list", "--json", "-"});
    EXPECT_EQ(r.exit_code, 0) << r.err;
    const json list = json::parse(r.out, nullptr, false);
    return list.is_array() && !list.empty() ? list[0] : json::object();
  }
  /// Watches until a line has these words; what was told.
  std::string watched_until(const std::string& words) const {
    RunOptions options;
    options.signal = SIGINT;
    options.signal_when = [&](const std::string& out, const std::string&) {
      return out.find(words) != out.npos;
    };
    const RunResult r = machines({"watch", "left", "--interval-s", "0.2"}, options);
    EXPECT_EQ(r.exit_code, 130) << r.err;
    return r.out;
  }
  /// `slicefarm serve`, until the test ends.
  void serve() {
    const std::string token(40, 't'), file = folder / "token";
    test::write_file(file, token);
    ::chmod(file.c_str(), 0600);
    served_ = std::make_unique<Child>(std::vector<std::string>{
        kSlicefarm, "serve", "--listen", "127.0.0.1:0", "--token-file", file, "--dir", farm()});
    const std::string line = served_->line();
    client_ = std::make_unique<httplib::Client>("127.0.0.1",
                                                std::atoi(line.c_str() + line.rfind(':') + 1));
    client_->set_default_headers({{"Authorization", "Bearer " + token}});
    client_->set_read_timeout(60);
  }
  static Command start() { return {"start", "left", "--plate-is-empty", "--vat-is-filled"}; }

  std::unique_ptr<Child> served_;
  std::unique_ptr<httplib::Client> client_;
};

TEST_F(BridgeMachine, PrintsWhatIsSentAndTheFarmNeedNotStay) {
  const std::string printer = make_real_printer(), stack = make_stack(printer);
  Sim sim = start_sim(printer, false);
  set_up(printer, sim);
  EXPECT_EQ(left()["state"], "idle");
  // Sent is not started, and both words are wanted.
  const RunResult sent = machines({"send", stack, "left"});
  ASSERT_EQ(sent.exit_code, 0) << sent.err;
  EXPECT_EQ(machines({"start", "left", "--plate-is-empty"}).exit_code, 2);
  EXPECT_EQ(status(printer)["running"], false);
  // The program that starts it ends at once: the print is none of its children that it waits for.
  const RunResult started = machines(start());
  ASSERT_EQ(started.exit_code, 0) << started.err << print_log();
  EXPECT_EQ(left()["record"]["print_state"], "begun");
  // It takes no other file while it prints.
  EXPECT_EQ(machines({"send", stack, "left"}).exit_code, 2);
  EXPECT_THAT(watched_until("left: finished"), HasSubstr("left: printing"));
  const json view = left();
  EXPECT_EQ(view["record"]["print_state"], "finished") << print_log();
  EXPECT_EQ(view["record"]["plate_full"], true);
  EXPECT_EQ(machines(start()).exit_code, 2) << "the plate is full";
  // What was shown is the stack, layer by layer.
  EXPECT_EQ(sim.child->end(SIGTERM), 0);
  const StackReader shown(sim.shown, folder.path()), wanted(stack, folder.path());
  const Grid& grid = wanted.info().grid;
  ASSERT_EQ(shown.info().grid.layers, grid.layers);
  const auto pixels =
      static_cast<std::size_t>(grid.width_px) * static_cast<std::size_t>(grid.height_px);
  std::vector<std::uint8_t> a(pixels), b(pixels);
  for (int n = 0; n < grid.layers; ++n) {
    shown.read_slice(n, a.data());
    wanted.read_slice(n, b.data());
    EXPECT_EQ(a, b) << n;
  }
}

TEST_F(BridgeMachine, IsStoppedFromTheFarm) {
  const std::string printer = make_real_printer(), stack = make_stack(printer);
  Sim sim = start_sim(printer, false);
  set_up(printer, sim);
  serve();
  ASSERT_EQ(machines({"send", stack, "left"}).exit_code, 0);
  const RunResult started = machines(start());
  ASSERT_EQ(started.exit_code, 0) << started.err << print_log();
  // From a page as from a command: the farm's server steers it, and starts nothing there.
  const auto post = [&](const std::string& what) {
    const auto answer = client_->Post("/api/v1/machines/left/" + what, "{}", "application/json");
    return answer ? answer->status : -1;
  };
  EXPECT_EQ(post("start"), 404);
  EXPECT_EQ(post("send"), 400);
  // What the bridge refuses is told, in its words: this stack can't be paused without a mark.
  EXPECT_THAT(machines({"pause", "left"}).err, HasSubstr("pause is refused"));
  EXPECT_EQ(post("stop"), 200) << print_log();
  EXPECT_TRUE(wait_until([&] { return left()["record"]["print_state"] == "stopped"; }));
  EXPECT_EQ(left()["record"]["plate_full"], true);
  EXPECT_EQ(machines({"stop", "left"}).exit_code, 2) << "prints nothing";
  EXPECT_EQ(status(printer)["running"], false);
  ASSERT_EQ(machines({"cleared", "left"}).exit_code, 0);
  EXPECT_EQ(left()["record"]["plate_full"], false);
}

}  // namespace
}  // namespace slicecorr::farm
