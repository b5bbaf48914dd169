// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file machine.hpp
/// What the bridge knows of a machine, besides the optics in `Printer`: how its stage moves, what
/// its lamps can do, how it is spoken to. All of it is data in the printer file, so that another
/// machine needs no code: tables [stage], [lamps], [bridge], [projector] and [modbus]
/// (docs/printer-files.md has the ranges). Plain values; all functions are thread-safe.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr::bridge {

/// Number of what the display shows when it shows no slice.
inline constexpr int kBlackFrame = -1;

/// [stage]. Positions are heights of the platform above the window, up is away from it. Where the
/// printer has [rotation] the stage turns its vial: positions are arcs at the vial's inner wall, from
/// the index on, in the direction of [rotation], over whole turns.
struct Stage {
  double um_per_deg = 0;          ///< of a stage that turns: the arc of a degree; else 0
  double max_speed_um_s = 0;      ///< from max_speed_mm_h, > 0
  double travel_um = 0;           ///< from travel_mm, > 0
  double acceleration_um_s2 = 0;  ///< of ramps, > 0
  double tolerance_um = 20;       ///< > 0: largest difference of commanded and measured position
  double home_um = 0;             ///< >= 0: where prints begin, the platform on the window
  /// Layer by layer. Speed of lifting and of every move outside of the print; that of printing when
  /// the file has none.
  double lift_um = 3000, lift_speed_um_s = 1000;
  double return_speed_um_s = 1000;      ///< of coming back after a lift; as the lift without it
  double settle_s = kDefaultLiftWaitS;  ///< 0..600: from the end of a move until light may come
  double fastest_um_s() const {
    return std::max({max_speed_um_s, lift_speed_um_s, return_speed_um_s});
  }
  bool turns() const { return um_per_deg > 0; }
  double turn_um() const { return 360 * um_per_deg; }  ///< arc of a whole turn
};

/// A lamp as it is driven: a share of the intensity that the calibration stands for; for UV light,
/// of the greatest in its calibration.
struct LampDrive {
  double min_share = 0;     ///< 0..1: below it the lamp is dark; 0: any share
  double max_share = 1;     ///< 1..10
  double tolerance = 0.05;  ///< largest difference of asked and measured share, up to 0.5
  double settle_s = 0.05;   ///< until light is within 1 % of a step of what is asked, when warm
  double warm_up_s = 0;     ///< 0..3600: after so long the lit lamp gives all its light
};

/// [bridge]: when to give up. Distances count along the stage's way.
struct MachineLimits {
  double cycle_s = 0.01;             ///< between exchanges, 0.001..0.1
  double response_timeout_s = 0.04;  ///< of a request and all of its answer, 0.005..1
  double heartbeat_timeout_s = 0.3;  ///< 0.02..10: without an answer that long the print has failed
  double watchdog_s = 0.3;           ///< what the machine is told: lamps off without a heartbeat
  /// > 0: a frame that is further off its place is late. Stages that turn: 0 is half of the angle
  /// for which a frame is shown.
  double max_late_um = 5;
  int max_late_frames = 0;        ///< late frames borne (each within ten times max_late_um)
  double display_latency_s = 0;   ///< from showing a frame to its light, 0..1
  double max_temperature_c = 60;  ///< up to 200: above it a print fails
  int ring_frames = 16;           ///< decoded ahead, 8..1024, as far as memory goes (`FrameRing`)
};

/// [projector]: which channel of the display's colours carries which light.
enum class Channel { red, green, blue, all };
std::string_view name_of(Channel channel);
struct Projector {
  Channel blue = Channel::all;  ///< all: a grey picture; not where UV is patterned
  Channel uv = Channel::red;    ///< only where UV is patterned
  std::string output;           ///< name of the display, "HDMI-1"; empty: the only or first one
};

/// [uv_display]: a display of its own for patterned UV images, whose pixels lie on those of
/// [display] at the window. What the table does not say is as [display] and [bridge] have it.
struct UvDisplay {
  int width_px = 0, height_px = 0;  ///< of what it shows, turned as `orientation` says
  Orientation orientation;          ///< how the plate lies in its images
  double latency_s = 0;             ///< from showing an image to its light, 0..1
  Channel channel = Channel::all;   ///< that carries UV images; all: a grey picture
  std::string output;               ///< name of the display, "HDMI-2"; empty: the first one
};

enum class Transport { tcp, rtu };
enum class WordOrder { big, little };  ///< which register of two holds the higher half
/// One request that writes and reads, or one to write and one to read holding or input registers.
enum class Exchange { fc23, fc16_fc3, fc16_fc4 };

/// What can be written and read. Those marked * must be in every map. On the wire and in the file,
/// stages that turn have degrees for um: target_deg, speed_deg_s, acceleration_deg_s2, stage_deg,
/// stage_speed_deg_s.
enum class Signal {
  // written
  sequence,            ///< * rises with each exchange
  heartbeat,           ///< * changes after each good answer: the watchdog is fed by it
  command,             ///< * see Command
  watchdog_s,          ///< how long the machine waits for a heartbeat
  target_um,           ///< * where the stage goes
  speed_um_s,          ///< * how fast
  acceleration_um_s2,  ///< and how it gets there
  blue_share,          ///< * set-point of the blue lamp, 1: as calibrated
  uv_mw_cm2,           ///< set-point of the UV lamp (flood); * where the printer has one
  frame,               ///< number of the frame that is shown, or `kBlackFrame`
  job,                 ///< 1 from the first motion or light of a print to its good end, else 0
  // read
  sequence_echo,     ///< * of the last set-points that were taken over
  state,             ///< * see MachineState
  stage_um,          ///< * measured; a stage that turns may have stage_speed_um_s alone
  stage_speed_um_s,  ///< measured; else from positions
  blue_measured,     ///< * share, measured
  uv_measured,       ///< mW/cm²; * where the printer has a UV lamp
  temperature_c,
  door_open,
  stop_pressed,
  lamp_failed,
  stage_failed,
  over_temperature,  ///< this and the four before: bits; 1: so it is
  watchdog_tripped,  ///< bit
  latched,           ///< bit: a print has failed on it, and nobody has reset it since
  job_kept,          ///< `job` as it was written last, whoever wrote it
  machine_time_s,    ///< the machine's own clock
};
enum class Command { off, run, stop, reset };  ///< off: lamps off, stage holds
enum class MachineState { idle, running, stopped, fault };

enum class RegisterType { u16, i16, u32, i32, bit };
/// Where a signal lives: value = raw * scale + offset.
struct Register {
  int address = 0;  ///< as on the wire, 0..65535
  RegisterType type = RegisterType::u16;
  int bit = 0;  ///< 0..15, of `RegisterType::bit`
  /// In the signal's unit (its name, docs/printer-files.md); of angles in um of arc.
  double scale = 1, offset = 0;
  /// How many registers of 16 bits it takes.
  int registers() const { return type == RegisterType::u32 || type == RegisterType::i32 ? 2 : 1; }
};

/// [modbus].
/// The number that comes after: 0 is what a machine echoes that has just started.
constexpr std::uint16_t next_sequence(std::uint16_t number) {
  return number == 0xffff ? 1 : static_cast<std::uint16_t>(number + 1);
}

struct RegisterMap {
  Transport transport = Transport::tcp;
  std::string host = "127.0.0.1";
  int port = 1502;
  std::string device;  ///< path of the serial line; rtu
  int baud = 115200;   ///< bits per s; rtu
  char parity = 'N';   ///< N, E or O; rtu
  int unit = 1;        ///< the machine's address on the wire; tcp: from 0, rtu: from 1
  WordOrder word_order = WordOrder::big;
  Exchange exchange = Exchange::fc23;
  std::map<Signal, Register> write, read;
  std::map<Command, int> commands;     ///< raw values; standard ones 0, 1, 2, 3
  std::map<MachineState, int> states;  ///< raw values; standard ones 0, 1, 2, 3
  /// Registers to exchange at once: first and number of those written, of those read.
  int write_address = 0, write_count = 0, read_address = 0, read_count = 0;
};

struct Machine {
  Printer printer;
  Stage stage;
  LampDrive blue, uv;
  MachineLimits limits;
  Projector projector;
  /// Nothing: UV images are shown in a channel of the one display (`Projector::uv`).
  std::optional<UvDisplay> uv_display;
  std::optional<RegisterMap> modbus;
  std::string path;  ///< of the file
  /// Sets where the machine is reached: `where` is "tcp:HOST:PORT" or "rtu:DEVICE"; empty: as the
  /// file has it. Throws `InputError` for anything else, and where there is no register map.
  void connect_to(const std::string& where);
  /// Whether the stage's place is measured. One that turns without an encoder is taken to be where
  /// it was told to be, as long as its speed is what it was told.
  bool has_encoder() const { return !modbus || modbus->read.contains(Signal::stage_um); }
};

/// Reads a printer file with all of it. Throws `InputError` naming file, line, key and what was
/// expected: signals that are missing or overlap, blocks beyond the limits of Modbus (121 written,
/// 125 read), values out of range.
Machine load_machine(const std::string& name_or_path);
/// The same from the text of a file; `source` names it in messages.
Machine parse_machine(std::string_view text, const std::string& source);

/// A display of its own for UV images that is in all as the blue one. Throws `InputError` where the
/// printer's UV light is not patterned.
UvDisplay uv_display_like_blue(const Machine& machine);
/// The machine as its UV display sees it: size, orientation, channel and latency are that display's,
/// and there is no UV light beside. `machine.uv_display` must be there.
Machine uv_display_machine(const Machine& machine);

/// Name of a signal as in printer files: "stage_um", or "stage_deg" of stages that turn.
std::string_view name_of(Signal signal, bool turns = false);

/// What goes out in a cycle. Idempotent: the same set-points twice do the same as once.
struct SetPoints {
  std::uint16_t sequence = 0;   ///< rises with each exchange, from 65535 to 0
  std::uint16_t heartbeat = 0;  ///< changes after each good answer
  Command command = Command::off;
  double target_um = 0;                           ///< stage position, above the window
  double speed_um_s = 0, acceleration_um_s2 = 0;  ///< greatest on the way there, >= 0
  double blue_share = 0;                          ///< of the calibration, >= 0; 0: dark
  double uv_mw_cm2 = 0;                           ///< of the flood lamp, >= 0; 0: dark
  std::int32_t frame = kBlackFrame;               ///< number of the slice that is shown
  double watchdog_s = 0.3;  ///< after so long without a new heartbeat the machine puts lamps off
  bool job = false;         ///< a print is on, from its first motion or light to its good end
};

/// What a machine answers in a cycle.
struct Status {
  std::uint16_t sequence_echo = 0;  ///< of the last set-points that were taken over
  MachineState state = MachineState::idle;
  double stage_um = 0;  ///< measured, above the window
  /// Nothing where the machine does not tell: speed (above 0: up), and temperature.
  std::optional<double> stage_speed_um_s, temperature_c;
  std::optional<double> machine_time_s;  ///< on the machine's own clock; nothing: it tells none
  std::optional<double> uv_measured;     ///< mW/cm²; nothing: it does not tell
  double blue_measured = 0;              ///< share, 1: as calibrated
  bool door_open = false, stop_pressed = false, lamp_failed = false, stage_failed = false,
       over_temperature = false, watchdog_tripped = false;
  std::optional<bool> latched;   ///< a print has failed on it, and nobody has reset it since
  std::optional<bool> job_kept;  ///< `SetPoints::job` as it was written last, by anybody
};

/// Registers that lie together.
struct RegisterRun {
  int address = 0, count = 0;
};
/// Runs of the registers of set-points, in the order in which they are written: the lamps' first,
/// the heartbeat's last but one, the sequence number's last. So a machine that gives the sequence
/// number back has taken all of them over. A single run where `exchange` is fc23.
std::vector<RegisterRun> write_runs(const RegisterMap& map);
/// Runs of the registers that carry these signals alone.
std::vector<RegisterRun> write_runs(const RegisterMap& map, std::span<const Signal> signals);
/// Number of requests in an exchange; each has its own response timeout.
int requests_of(const RegisterMap& map);

/// Registers of a block for set-points, and back; for both ends of the wire. Values beyond what a
/// register can hold are clamped to it. 32 bits are two registers in the map's word order; never
/// floating point on the wire.
std::vector<std::uint16_t> encode(const RegisterMap& map, const SetPoints& set_points);
SetPoints decode_set_points(const RegisterMap& map, const std::vector<std::uint16_t>& registers);
std::vector<std::uint16_t> encode(const RegisterMap& map, const Status& status);
/// Throws `DeviceError` when the state is none of the map's.
Status decode_status(const RegisterMap& map, const std::vector<std::uint16_t>& registers);

}  // namespace slicecorr::bridge
