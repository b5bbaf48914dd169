// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Printer files as the bridge reads them, and set-points and status as registers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "sim_fixture.hpp"
#include "slicecorr/bridge/machine.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

using slicecorr::test::kSmallMachine;
using slicecorr::test::machine_of;
using slicecorr::test::replaced;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std::string refusal(const std::string& text) {
  try {
    machine_of(text);
  } catch (const InputError& e) {
    return e.what();
  }
  return "nothing was refused";
}

int line_of(const std::string& text, const std::string& part) {
  const auto at = text.find(part);
  return at == std::string::npos
             ? 0
             : 1 + static_cast<int>(std::count(text.begin(), text.begin() + at, '\n'));
}

// --- Files

TEST(Machine, HasTheUnitsOfItsMembers) {
  const Machine m = machine_of(kSmallMachine);
  EXPECT_DOUBLE_EQ(m.stage.max_speed_um_s, 1000);
  EXPECT_DOUBLE_EQ(m.stage.travel_um, 20000);
  EXPECT_DOUBLE_EQ(m.stage.acceleration_um_s2, 1000);
  EXPECT_DOUBLE_EQ(m.stage.home_um, 1000);
  EXPECT_DOUBLE_EQ(m.stage.lift_um, 3000);
  EXPECT_DOUBLE_EQ(m.stage.lift_speed_um_s, 1000);  // that of printing
  EXPECT_DOUBLE_EQ(m.blue.max_share, 2);
  EXPECT_DOUBLE_EQ(m.limits.watchdog_s, 0.3);
  EXPECT_EQ(m.printer.name, "small");
  ASSERT_TRUE(m.modbus);
  EXPECT_EQ(m.modbus->write_address, 0);
  EXPECT_EQ(m.modbus->write_count, 16);
  EXPECT_EQ(m.modbus->read_address, 100);
  EXPECT_EQ(m.modbus->read_count, 14);
  EXPECT_EQ(m.modbus->commands.at(Command::stop), 2);
  EXPECT_EQ(m.modbus->states.at(MachineState::fault), 3);
}

TEST(Machine, WithoutTheNewTablesIsRefusedByName) {
  const std::string bare = kSmallMachine.substr(0, kSmallMachine.find("acceleration_mm_s2"));
  EXPECT_THAT(refusal(bare), HasSubstr("stage.acceleration_mm_s2: missing"));
}

TEST(Machine, ShippedPrintersCanBePrintedOn) {
  for (const char* name : {"dual-wavelength-dlp", "dual-wavelength-dlp-gamma3"}) {
    const Machine m = load_machine(std::string(SLICECORR_PRINTERS_DIR "/") + name + ".toml");
    ASSERT_TRUE(m.modbus) << name;
    EXPECT_EQ(m.modbus->write_count, 16);
    EXPECT_EQ(m.modbus->read_count, 14);
    // 800 mm/h are reached in 0.22 s over 25 um, as the file says.
    const double v = 800 / 3.6;
    EXPECT_NEAR(v / m.stage.acceleration_um_s2, 0.22, 0.005);
    EXPECT_NEAR(v * v / 2 / m.stage.acceleration_um_s2, 25, 0.5);
  }
}

struct Wrong {
  std::string from, to;
  std::string place;  ///< of the line that the message must name, in the changed text
  std::string message;
};

TEST(Machine, ErrorsNameFileLineKeyAndWhatIsExpected) {
  const std::vector<Wrong> cases{
      {"acceleration_mm_s2 = 1", "acceleration_mm_s2 = 0", "acceleration_mm_s2",
       "stage.acceleration_mm_s2: is 0; expected a number above 0"},
      {"tolerance_um = 20", "tolerence_um = 20", "tolerence_um",
       "stage.tolerence_um: unknown key; did you mean 'tolerance_um'?"},
      {"home_mm = 1", "home_mm = 20", "home_mm = 20", "stage.home_mm: is 20; expected less than"},
      {"min_share = 0.02", "min_share = 1.5", "min_share", "lamps.blue.min_share: is 1.5"},
      {"max_share = 2", "max_share = 0.5", "max_share", "lamps.blue.max_share: is 0.5"},
      {"[lamps.uv]", "[lamps.red]", "[lamps.red]", "lamps.red: unknown key"},
      {"[lamps.uv]", "[lamps.uv]\nmax_share = 1.5", "max_share = 1.5", "calibration under [uv]"},
      {"cycle_s = 0.01", "cycle_s = 0.2", "cycle_s", "bridge.cycle_s: is 0.2; expected a number"},
      {"watchdog_s = 0.3\nmax", "watchdog_s = 0.05\nmax", "watchdog_s = 0.05",
       "bridge.watchdog_s: is 0.05; expected at least three cycles"},
      {"heartbeat_timeout_s = 0.3", "heartbeat_timeout_s = 0.05", "heartbeat_timeout_s",
       "at least two response timeouts"},
      {"transport = \"tcp\"", "transport = \"udp\"", "transport", "\"tcp\" or \"rtu\""},
      {"transport = \"tcp\"", "transport = \"rtu\"", "[modbus]", "modbus.device: missing"},
      {"unit = 1", "unit = 256", "unit", "expected 0 to 255"},
      {"exchange = \"fc23\"", "exchange = \"fc5\"", "exchange", "\"fc23\" or \"fc16+fc3\""},
      {"word_order = \"big\"", "word_ordre = \"big\"", "word_ordre", "did you mean 'word_order'"},
      {"heartbeat = { address = 1 }\n", "", "[modbus.write]", "write.heartbeat: missing"},
      {"uv_mw_cm2 = { address = 12, type = \"u32\", scale = 0.001 }\nframe = { address = 14",
       "frame = { address = 12", "[modbus.write]", "write.uv_mw_cm2: missing"},
      {"stage_um = { address = 102", "stage_um = { address = 101", "stage_um",
       "overlaps modbus.read.state at address 101"},
      {"sequence_echo = { address = 100 }", "sequence_echo = { address = 15 }", "sequence_echo",
       "overlaps modbus.write.frame at address 15"},
      {"stop_pressed = { address = 111, bit = 1 }", "stop_pressed = { address = 111, bit = 0 }",
       "stop_pressed", "overlaps modbus.read.door_open at address 111"},
      {"stop_pressed = { address = 111, bit = 1 }", "stop_pressed = { address = 111, bit = 16 }",
       "stop_pressed", "bit: is 16; expected 0 to 15"},
      {"frame = { address = 14, type = \"i32\" }", "frame = { address = 14, type = \"u32\" }",
       "frame = {", "holds 0 to 4.29497e+09; this machine needs -1 to 32766"},
      {"frame = { address = 14", "frame = { address = 17", "[modbus.write]",
       "leaves out 3 of the registers 0 to 18, which function 23 writes at once"},
      {"machine_time_s = { address = 112", "machine_time_s = { address = 224", "modbus",
       "covers 126 registers, 100 to 225; Modbus reads at most 125 at once"},
      {"target_um = { address = 4, type = \"i32\", scale = 0.01 }",
       "target_um = { address = 4, type = \"i32\", scale = 100 }", "target_um",
       "has steps of 100; expected at most 10"},
      {"target_um = { address = 4, type = \"i32\", scale = 0.01 }",
       "target_um = { address = 4, type = \"i32\", scale = 1e-6 }", "target_um",
       "this machine needs 0 to 20000"},
      {"sequence = { address = 0 }", "sequence = { address = 0, scale = 2 }", "sequence",
       "has scale 2; expected 1"},
      {"sequence = { address = 0 }", "sequence = { address = 0, type = \"i16\" }", "sequence",
       "this machine needs 0 to 65535"},
      {"sequence = { address = 0 }", "sequence = { address = 70000 }", "sequence",
       "expected 0 to 65535"},
      {"sequence = { address = 0 }", "sequence = { adress = 0 }", "sequence",
       "did you mean 'address'?"},
      {"sequence = { address = 0 }", "sequence = 0", "sequence", "expected a table"},
      {"blue_share = { address = 10, type = \"u32\", scale = 1e-6 }",
       "blue_share = { address = 10, type = \"u32\", scale = 0 }", "blue_share", "scale: is 0"},
      {"state = { address = 101 }", "state = { address = 101, type = \"bit\" }", "state",
       "expected a register, this is no yes or no"},
  };
  for (const Wrong& w : cases) {
    const std::string text = replaced(kSmallMachine, w.from, w.to);
    const std::string message = refusal(text);
    EXPECT_THAT(message, AllOf(HasSubstr("small.toml: line "), HasSubstr(w.message))) << w.to;
    const int line = w.place == "modbus" ? 0 : line_of(text, w.place);
    if (line > 0) {
      EXPECT_THAT(message, HasSubstr("line " + std::to_string(line) + ":")) << w.to;
    }
  }
}

TEST(Machine, CommandsAndStatesHaveTheirOwnValues) {
  const std::string words =
      kSmallMachine + "[modbus.commands]\noff = 10\nrun = 20\nstop = 30\nreset = 40\n";
  EXPECT_EQ(machine_of(words).modbus->commands.at(Command::reset), 40);
  EXPECT_THAT(refusal(replaced(words, "stop = 30", "stop = 20")),
              HasSubstr("modbus.commands.stop: is 20, as is run"));
  EXPECT_THAT(refusal(replaced(words, "stop = 30", "stop = -1")),
              HasSubstr("which its register can't hold"));
  EXPECT_THAT(refusal(replaced(words, "stop = 30", "halt = 30")), HasSubstr("commands.halt"));
}

TEST(Machine, TheExampleOfTheDocumentsCanBeRead) {
  const std::string document =
      slicecorr::test::text_of(SLICECORR_SOURCE_DIR "/docs/printer-files.md");
  const auto begin = document.find("```toml\n"), end = document.find("```\n", begin + 8);
  ASSERT_NE(end, std::string::npos);
  const std::string example = document.substr(begin + 8, end - begin - 8);
  const RegisterMap map =
      *machine_of(kSmallMachine.substr(0, kSmallMachine.find("[modbus]")) + example).modbus;
  EXPECT_EQ(map.transport, Transport::rtu);
  EXPECT_EQ(map.write_address, 4096);
  EXPECT_EQ(map.write_count, 9);
  EXPECT_EQ(map.read_count, 10);
  SetPoints s;
  s.command = Command::reset;
  s.target_um = 99000;  // 500 steps of 2 um below the upper end
  const auto r = encode(map, s);
  EXPECT_EQ(r[0], 128);
  EXPECT_EQ(r[1], 500);
  EXPECT_EQ(r[2], 0);
}

TEST(Machine, TheDocumentsListAllKeysAndSignals) {
  const std::string document =
      slicecorr::test::text_of(SLICECORR_SOURCE_DIR "/docs/printer-files.md");
  for (int i = 0; i <= static_cast<int>(Signal::machine_time_s); ++i) {
    const std::string name(name_of(static_cast<Signal>(i)));
    EXPECT_THAT(document, HasSubstr("`" + name + "`"));
  }
  // What the small machine does not say it has in the shipped file.
  for (const std::string& text :
       {kSmallMachine,
        slicecorr::test::text_of(SLICECORR_PRINTERS_DIR "/dual-wavelength-dlp.toml")}) {
    std::istringstream lines(text.substr(text.find("[stage]")));
    for (std::string line; std::getline(lines, line);) {
      const auto is = line.find(" = ");
      if (line.starts_with("[provenance]")) break;
      if (is == std::string::npos || line.starts_with("#")) continue;
      EXPECT_THAT(document, HasSubstr(line.substr(0, is)));
    }
  }
}

// --- Registers

TEST(Registers, AreWhatTheFileSays) {
  const RegisterMap map = *machine_of(kSmallMachine).modbus;
  SetPoints s;
  s.sequence = 0xabcd;
  s.heartbeat = 7;
  s.command = Command::run;
  s.watchdog_s = 0.25;
  s.target_um = 12345.67;  // raw 1234567 = 0x0012d687
  s.speed_um_s = 222.222;
  s.acceleration_um_s2 = 1000;
  s.blue_share = 0.5;
  s.uv_mw_cm2 = 123.456;
  s.frame = -1;
  EXPECT_THAT(encode(map, s), ElementsAre(0xabcd, 7, 1, 250, 0x0012, 0xd687, 0x0003, 0x640e, 0,
                                          10000, 7, 0xa120, 1, 0xe240, 0xffff, 0xffff));
  RegisterMap little = map;
  little.word_order = WordOrder::little;
  EXPECT_THAT(encode(little, s), ElementsAre(0xabcd, 7, 1, 250, 0xd687, 0x0012, 0x640e, 0x0003,
                                             10000, 0, 0xa120, 7, 0xe240, 1, 0xffff, 0xffff));
}

TEST(Registers, ThatLieApartAreRunsWithTheSequenceNumberLast) {
  const auto runs_of = [](const std::vector<std::pair<std::string, std::string>>& changes) {
    std::string text =
        replaced(kSmallMachine, "response_timeout_s = 0.04", "response_timeout_s = 0.02");
    for (const auto& [what, by] : changes) text = replaced(text, what, by);
    std::vector<std::pair<int, int>> runs;
    for (const RegisterRun& run : write_runs(*machine_of(text).modbus)) {
      runs.emplace_back(run.address, run.count);
    }
    return runs;
  };
  using Runs = std::vector<std::pair<int, int>>;
  const std::pair<std::string, std::string> apart{"exchange = \"fc23\"", "exchange = \"fc16+fc3\""};
  EXPECT_EQ(runs_of({}), (Runs{{0, 16}}));
  EXPECT_EQ(runs_of({apart}), (Runs{{0, 16}}));
  EXPECT_EQ(runs_of({apart, {"sequence = { address = 0 }", "sequence = { address = 90 }"}}),
            (Runs{{1, 15}, {90, 1}}));
  EXPECT_EQ(runs_of({apart, {"target_um = { address = 4,", "target_um = { address = 60000,"}}),
            (Runs{{6, 10}, {60000, 2}, {0, 4}}));
  // Input registers are others than those written, even where addresses are the same.
  EXPECT_EQ(runs_of({{"exchange = \"fc23\"", "exchange = \"fc16+fc4\""},
                     {"state = { address = 101 }", "state = { address = 1 }"}}),
            (Runs{{0, 16}}));
}

TEST(Registers, HoldWhatIsBelowZero) {
  const RegisterMap map = *machine_of(kSmallMachine).modbus;
  Status s;
  s.stage_um = -0.05;
  s.stage_speed_um_s = -1000;
  s.temperature_c = -12.5;
  const auto r = encode(map, s);
  EXPECT_EQ(r[2], 0xffff);
  EXPECT_EQ(r[3], 0xfffb);
  EXPECT_EQ(r[10], 0xff83);
  const Status back = decode_status(map, r);
  EXPECT_DOUBLE_EQ(back.stage_um, -0.05);
  EXPECT_DOUBLE_EQ(*back.stage_speed_um_s, -1000);
  EXPECT_DOUBLE_EQ(*back.temperature_c, -12.5);
}

TEST(Registers, ClampWhatTheyCanNotHold) {
  const RegisterMap map = *machine_of(kSmallMachine).modbus;
  SetPoints s;
  s.target_um = -1e300;
  s.speed_um_s = 1e300;
  s.acceleration_um_s2 = -5;
  s.blue_share = kNaN;
  s.watchdog_s = 1e9;
  const auto r = encode(map, s);
  EXPECT_EQ(r[4], 0x8000);
  EXPECT_EQ(r[5], 0);
  EXPECT_EQ(r[6], 0xffff);
  EXPECT_EQ(r[7], 0xffff);
  EXPECT_EQ(r[8] | r[9], 0);
  EXPECT_EQ(r[10] | r[11], 0);  // what is no number lights nothing
  EXPECT_EQ(r[3], 0xffff);
}

TEST(Registers, GiveBackWhatWentIn) {
  std::mt19937 random(5);
  const auto in = [&](double least, double greatest) {
    return std::uniform_real_distribution<>(least, greatest)(random);
  };
  for (const WordOrder order : {WordOrder::big, WordOrder::little}) {
    RegisterMap map = *machine_of(kSmallMachine).modbus;
    map.word_order = order;
    for (int i = 0; i < 2000; ++i) {
      SetPoints s;
      s.sequence = static_cast<std::uint16_t>(random());
      s.heartbeat = static_cast<std::uint16_t>(random());
      s.command = static_cast<Command>(random() % 4);
      s.watchdog_s = in(0, 60);
      s.target_um = in(-2e7, 2e7);
      s.speed_um_s = in(0, 4e6);
      s.acceleration_um_s2 = in(0, 4e8);
      s.blue_share = in(0, 4000);
      s.uv_mw_cm2 = in(0, 4e6);
      s.frame = static_cast<std::int32_t>(random());
      const SetPoints b = decode_set_points(map, encode(map, s));
      EXPECT_EQ(b.sequence, s.sequence);
      EXPECT_EQ(b.heartbeat, s.heartbeat);
      EXPECT_EQ(b.command, s.command);
      EXPECT_EQ(b.frame, s.frame);
      // Half a step, and the rounding of the numbers themselves.
      EXPECT_NEAR(b.watchdog_s, s.watchdog_s, 0.0005 * 1.001);
      EXPECT_NEAR(b.target_um, s.target_um, 0.005 * 1.001);
      EXPECT_NEAR(b.speed_um_s, s.speed_um_s, 0.0005 * 1.001);
      EXPECT_NEAR(b.acceleration_um_s2, s.acceleration_um_s2, 0.05 * 1.001);
      EXPECT_NEAR(b.blue_share, s.blue_share, 5e-7 * 1.001);
      EXPECT_NEAR(b.uv_mw_cm2, s.uv_mw_cm2, 0.0005 * 1.001);

      Status t;
      t.sequence_echo = s.sequence;
      t.state = static_cast<MachineState>(random() % 4);
      t.stage_um = s.target_um;
      t.stage_speed_um_s = in(-2e6, 2e6);
      t.blue_measured = s.blue_share;
      t.uv_measured = s.uv_mw_cm2;
      t.temperature_c = in(-50, 200);
      t.machine_time_s = in(0, 4e6);
      const unsigned bits = random();
      t.door_open = (bits & 1) != 0;
      t.stop_pressed = (bits & 2) != 0;
      t.lamp_failed = (bits & 4) != 0;
      t.stage_failed = (bits & 8) != 0;
      t.over_temperature = (bits & 16) != 0;
      t.watchdog_tripped = (bits & 32) != 0;
      const auto registers = encode(map, t);
      EXPECT_EQ(registers[11], bits & 63);
      const Status u = decode_status(map, registers);
      EXPECT_EQ(u.sequence_echo, t.sequence_echo);
      EXPECT_EQ(u.state, t.state);
      EXPECT_NEAR(u.stage_um, t.stage_um, 0.005 * 1.001);
      EXPECT_NEAR(*u.stage_speed_um_s, *t.stage_speed_um_s, 0.0005 * 1.001);
      EXPECT_NEAR(u.blue_measured, t.blue_measured, 5e-7 * 1.001);
      EXPECT_NEAR(*u.uv_measured, *t.uv_measured, 0.0005 * 1.001);
      EXPECT_NEAR(*u.temperature_c, *t.temperature_c, 0.05 * 1.001);
      EXPECT_NEAR(*u.machine_time_s, *t.machine_time_s, 0.0005 * 1.001);
      EXPECT_EQ(u.door_open, t.door_open);
      EXPECT_EQ(u.stop_pressed, t.stop_pressed);
      EXPECT_EQ(u.lamp_failed, t.lamp_failed);
      EXPECT_EQ(u.stage_failed, t.stage_failed);
      EXPECT_EQ(u.over_temperature, t.over_temperature);
      EXPECT_EQ(u.watchdog_tripped, t.watchdog_tripped);
    }
  }
}

TEST(Registers, OfAnotherMachineMayCountDownFromAnOffset) {
  // Depth below the upper end, in steps of 5 um.
  const std::string text =
      replaced(kSmallMachine, "stage_um = { address = 102, type = \"i32\", scale = 0.01 }",
               "stage_um = { address = 102, type = \"u16\", scale = -5, offset = 20000 }");
  const RegisterMap map = *machine_of(text).modbus;
  Status s;
  s.stage_um = 15000;
  EXPECT_EQ(encode(map, s)[2], 1000);
  EXPECT_DOUBLE_EQ(decode_status(map, encode(map, s)).stage_um, 15000);
}

TEST(Registers, ThatAMachineLacksAreNotMadeUp) {
  std::string text = kSmallMachine;
  for (const char* line : {"stage_speed_um_s = { address = 104, type = \"i32\", scale = 0.001 }\n",
                           "temperature_c = { address = 110, type = \"i16\", scale = 0.1 }\n",
                           "machine_time_s = { address = 112, type = \"u32\", scale = 0.001 }\n",
                           "door_open = { address = 111, bit = 0 }\n"}) {
    text = replaced(text, line, "");
  }
  const RegisterMap map = *machine_of(text).modbus;
  EXPECT_EQ(map.read_count, 12);
  Status s;
  s.temperature_c = 80;
  s.machine_time_s = 5;
  s.door_open = true;
  const Status back = decode_status(map, encode(map, s));
  EXPECT_FALSE(back.temperature_c);
  EXPECT_FALSE(back.machine_time_s);
  EXPECT_FALSE(back.stage_speed_um_s);
  EXPECT_FALSE(back.door_open);
}

TEST(Registers, ThatMakeNoSenseAreADeviceError) {
  const RegisterMap map = *machine_of(kSmallMachine).modbus;
  auto status = encode(map, Status{});
  status[1] = 77;
  EXPECT_THROW(decode_status(map, status), DeviceError);
  EXPECT_THROW(decode_status(map, std::vector<std::uint16_t>(5)), DeviceError);
  auto set_points = encode(map, SetPoints{});
  set_points[2] = 77;
  EXPECT_THROW(decode_set_points(map, set_points), DeviceError);
  EXPECT_THROW(decode_set_points(map, {}), DeviceError);
}

TEST(Names, AreThoseOfTheFiles) {
  EXPECT_EQ(name_of(Signal::stage_um), "stage_um");
  EXPECT_EQ(name_of(Signal::watchdog_tripped), "watchdog_tripped");
}

}  // namespace
}  // namespace slicecorr::bridge
