// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file machines.hpp
/// Printers that the farm sends files to over the network: what DIR/machines.toml says of them, one
/// state machine for all of them, and what is remembered of each so that no print is lost or begun
/// twice.
///
/// A machine's answer is never taken for its deed: what was asked counts once a later look at its
/// status shows it. Uploading and starting are two acts. A start uses up somebody's word that the
/// plate is empty; after it nothing starts until somebody says so again, whatever broke in between.
///
/// What a machine refuses, and what is refused before anything is sent, throws `InputError`: nothing
/// was done. What gets no answer throws `DeviceError`: whether it was done is not known, and the
/// record says so. Plain values and functions are thread-safe; an adapter, and a `MachineRoom`, is for
/// one thread at a time. Times are seconds by the steady clock unless they are called wall clock.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/job.hpp"

namespace slicecorr::farm {

/// What a machine speaks.
enum class MachineKind { sdcp3, sdcp1, nanodlp, odyssey, prusalink, octoprint, bridge };
inline constexpr int kMachineKinds = 7;
/// "sdcp3", "nanodlp" ...
const char* name_of(MachineKind kind);
/// Nothing where no kind is called so.
std::optional<MachineKind> machine_kind_named(const std::string& name);

/// One [[machine]] of machines.toml.
struct MachineSpec {
  std::string name;  ///< small letters, digits, - and _; at most 60
  MachineKind kind = MachineKind::sdcp3;
  std::string host;     ///< name or address, without a port
  int port = 0;         ///< 0: the kind's own
  std::string printer;  ///< jobs for this printer may be sent to it
  std::string format;   ///< ending of the files that it reads, "ctb"; empty: as the machine says
  int width_px = 0, height_px = 0;  ///< of its display; 0: as the machine says
  std::string id;                   ///< MainboardID of SDCP; empty: asked for
  std::string key_file;             ///< whole path of the file with its key; empty: none
  std::string user;                 ///< of a login with a password
  std::string login;                ///< "digest", "key" or "none"; empty: the kind's own
  std::string profile;              ///< number of NanoDLP's resin profile; empty: its only one
  std::string page;                 ///< address of a page of its own, for a link
  int discovery_port = 3000;        ///< SDCP's, UDP
  /// SDCP 1: the address of this computer at which the machine finds broker and file.
  std::string own_address;
  std::vector<std::string> options, status_options;  ///< of `printbridge print` and `status`
  bool send_when_done = false;  ///< jobs for it are sent by the server, one after the other
  std::string files_folder;     ///< of a bridge: where what is sent to it lies on this computer
  /// Keys of jobs and their values, as JSON: the rule for what comes from slicers (as_printer.hpp).
  std::string job_rule = "{}";
};

/// Takes host and port from "HOST", "HOST:PORT" or "[::1]:PORT". Throws `InputError`.
void set_address(MachineSpec& machine, const std::string& address);
/// Reads DIR/machines.toml and, as machines of the kind `bridge`, DIR/bridges.toml; none without
/// either. Throws `InputError` with file, line and key; for names that stand twice, too.
std::vector<MachineSpec> read_machines(const FarmFolder& folder);
/// The machine of this name. Throws `InputError`.
MachineSpec machine_named(const FarmFolder& folder, const std::string& name);
/// The stack of a job that is done and for the machine's printer. Throws `InputError`.
std::string stack_for(const MachineSpec& machine, const Job& job);
/// Adds it to DIR/machines.toml; what stands there stays. Throws `InputError` where it is wrong or its
/// name is taken.
void add_machine(const FarmFolder& folder, const MachineSpec& machine);

/// Endings of files that the machine reads, as machines.toml or its kind says; empty: only it knows.
std::vector<std::string> formats_read_by(const MachineSpec& machine);

enum class MachineState {
  unknown,    ///< it does not answer, or says what nobody knows
  idle,       ///< takes a file or a start
  uploading,  ///< a file comes
  checking,   ///< looks at the file that came
  busy,       ///< does something else: tests itself, say
  starting,
  printing,
  pausing,
  paused,
  resuming,
  stopping,
  stopped,   ///< a print ended because somebody stopped it
  finished,  ///< a print ended as it should
  failed,    ///< a print ended otherwise
};
const char* name_of(MachineState state);
/// Whether a print is on: from its start to its end.
bool is_print(MachineState state);
/// Whether it takes a file or a start: idle, or a print has ended.
bool is_at_rest(MachineState state);

/// What a machine says of itself now. What it does not say is absent.
struct MachineStatus {
  MachineState state = MachineState::unknown;
  std::string phase;  ///< "exposing"; of an unknown number "other (99)"
  std::optional<int> layer, layers;
  std::optional<double> run_s, left_s;  ///< of the print
  std::string file;                     ///< its name, printable
  std::string task;                     ///< what the machine calls this print
  std::string trouble;                  ///< in words; empty: none
};

/// How a print ended, as its machine says.
struct PrintEnd {
  MachineState state = MachineState::unknown;  ///< `finished`, `stopped` or `failed`
  std::string why;                             ///< in words; empty: it does not say
};

/// What a machine is.
struct MachineFacts {
  std::string model, firmware, id;
  int width_px = 0, height_px = 0;   ///< 0: it does not say
  std::vector<std::string> formats;  ///< endings, small letters, no point; empty: it does not say
};

/// A file on its way to a machine.
struct MachineFile {
  std::string path;       ///< on this computer
  std::string name;       ///< as it is sent: `sent_name`
  std::string real_name;  ///< as people know it
  std::int64_t bytes = 0;
  std::string md5, sha256;  ///< small hex digits
  int layers = 0;
};
/// Hashes a file once. Throws `InputError` where it can't be read or is empty.
MachineFile machine_file(const std::string& path);
/// The name under which a file is sent: letters, digits, `.`, `_` and `-`, at most 64 bytes, what is
/// none of these becomes `_`; four digits of the contents' hash, then the ending in small letters.
/// `again` above 0: a further name for the same file.
std::string sent_name(const std::string& real_name, const std::string& sha256, int again = 0);

/// What is told during an upload: bytes that the machine has taken, of all.
using UploadProgress = std::function<void(std::int64_t done, std::int64_t all)>;

/// How long is waited for what. Tests have shorter ones.
struct MachineTimes {
  double answer_s = 10;  ///< for an answer
  double stall_s = 60;   ///< without a byte during an upload
  double look_s = 1;     ///< between two looks at the status
  double busy_s = 30;    ///< a start that meets a busy machine is asked again for so long
  double shown_s = 30;   ///< until the status must show what was asked
  double check_s = 60;   ///< for a machine to check a file, and a second more for each 10 MB
  double settle_s = 5;   ///< a machine that rests for so long without listing a file has dropped it
  double listed_s = 300;  ///< the same for machines that list late
  /// Looked at between waits; null: never asked to stop. Then `Cancelled` is thrown.
  const std::atomic<bool>* cancel = nullptr;
};

/// What the machine says of a file that it lists.
struct HeldFile {
  std::int64_t bytes = -1;  ///< -1: it does not say
};

/// One protocol. Every call is one question or request; nothing is waited for but its answer.
class MachineAdapter {
 public:
  virtual ~MachineAdapter() = default;
  virtual MachineFacts facts() = 0;
  virtual MachineStatus status() = 0;
  /// Sends the whole file, and returns when the machine has said that it has all of it; gives the name
  /// that the machine has for it.
  virtual std::string upload(const MachineFile& file, const UploadProgress& progress) = 0;
  /// Whether the machine lists the file.
  virtual std::optional<HeldFile> holds(const std::string& name) = 0;
  /// Whether the machine speaks with one program at a time, and leaves the one before.
  virtual bool one_asker() const { return false; }
  /// Whether a machine at rest may list a file only after minutes.
  virtual bool lists_late() const { return false; }
  /// Asks for a print. False: the machine is busy and nothing was begun; it may be asked again.
  virtual bool start(const std::string& name) = 0;
  virtual void pause() = 0;
  virtual void resume() = 0;
  virtual void stop() = 0;
  /// A small picture of the file that it prints, as PNG, where it has one; else empty. Unchecked.
  virtual std::string picture(const MachineStatus& status) {
    static_cast<void>(status);
    return {};
  }
  /// How a print of this machine's own ended, where it can be asked.
  virtual std::optional<PrintEnd> ended(const std::string& task) {
    static_cast<void>(task);
    return std::nullopt;
  }
};
/// Throws `InputError` for a kind that this program can't speak, or a key that can't be read.
std::unique_ptr<MachineAdapter> make_adapter(const MachineSpec& machine,
                                             const MachineTimes& times = {});

/// What the farm remembers of a machine: DIR/machines/NAME.json, written before it is acted upon.
struct MachineRecord {
  /// The file that was sent last.
  std::string file, real_name, sha256;
  std::int64_t bytes = 0;
  long long job = 0;  ///< whose output it is; 0: of none
  /// "" (none), "uploading", "stored" (the machine lists it), "broken".
  std::string file_state;
  /// The print that was asked for last.
  std::string print_file, print_task;
  /// "" (none), "asked" (whether it began is not known), "begun", "finished", "stopped", "failed", or
  /// "ended": nobody saw how.
  std::string print_state;
  std::string print_why;           ///< why it ended so, in words; empty: the machine does not say
  int last_layer = 0, layers = 0;  ///< of the print, when it was seen last; 0: not said
  std::int64_t print_asked_ms = 0, print_ended_ms = 0;  ///< wall clock, since 1970
  std::vector<long long> sent_jobs;  ///< whose outputs were sent, the last thousand of them
  bool stop_asked = false;
  bool plate_full = false;  ///< since a start, or since somebody's print was seen, until `cleared`
  std::string plate_why;    ///< in words
};
std::string record_json(const MachineRecord& record);

/// A machine with what is remembered of it.
struct MachineView {
  MachineSpec machine;
  MachineStatus status;  ///< where it does not answer, `unknown` with the trouble
  MachineRecord record;
};
/// As JSON, without keys or paths of them.
std::string view_json(const MachineView& view);

/// What is found before a file is sent, in words.
struct MachineCheck {
  std::vector<std::string> against;    ///< empty: it may be sent
  std::vector<std::string> unchecked;  ///< what could not be compared, and why
};

/// Somebody's word before a print.
struct StartWords {
  bool plate_is_empty = false, vat_is_filled = false;
};

/// All that is done to one machine, for commands, pages and other printers' servers alike. One act of
/// a farm at a time: others are refused, in this process and in others.
class MachineRoom {
 public:
  MachineRoom(const FarmFolder& folder, MachineSpec machine, MachineTimes times = {},
              std::unique_ptr<MachineAdapter> adapter = nullptr);
  ~MachineRoom();
  MachineRoom(const MachineRoom&) = delete;
  MachineRoom& operator=(const MachineRoom&) = delete;

  /// Asks the machine, and writes down what its answer says of the print. Does not throw for a machine
  /// that does not answer.
  MachineView look();
  /// What is remembered, without asking.
  MachineRecord record() const;
  MachineFacts facts();
  /// Reads the file's head and asks the machine; sends nothing.
  MachineCheck check(const std::string& path);
  /// Checks, uploads, waits until the machine lists the file. Gives the name that it has there.
  std::string send(const std::string& path, long long job = 0, const UploadProgress& progress = {});
  /// Begins the print of the file that was sent last. Returns when the machine's status shows it.
  void start(const StartWords& words);
  void pause();
  void resume();
  void stop();
  /// Somebody looked: the plate is empty. Refused while a print is on.
  void cleared();
  /// A small picture, as PNG, of what is on the machine: of the file that this farm sent last, from the
  /// file itself, unless the machine prints another, then the machine's own. Empty where there is
  /// none. `seen`: as it was looked at last.
  std::string picture(const MachineView& seen);

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// A machine that answered a call for printers.
struct FoundMachine {
  MachineKind kind = MachineKind::sdcp3;
  std::string host, name, model, id, version, firmware;
};
/// Asks for SDCP machines, and for PrusaLink and OctoPrint, which announce themselves (mDNS), by UDP:
/// `hosts` ("HOST" or "HOST:PORT"; groups, too), or all that a broadcast and mDNS's group reach where
/// there are none; only in the network where this computer has `own_address`, unless that is empty.
/// Listens for `wait_s`. Throws `DeviceError` where there is no network.
std::vector<FoundMachine> discover_machines(const std::vector<std::string>& hosts, double wait_s,
                                            const std::string& own_address = {});

}  // namespace slicecorr::farm
