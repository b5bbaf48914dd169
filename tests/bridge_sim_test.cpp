// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The program printer-sim: peers that we did not write over TCP and serial lines, the frame wire,
// lockstep, records; and what must not bring it down.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <modbus.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <cstring>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "frames/wire.hpp"
#include "run_program.hpp"
#include "sim_fixture.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::bridge {
namespace {

using test::Child;
using test::kSmallMachine;
using test::replaced;
using test::run_program;
using test::Sim;
using test::TemporaryFolder;
using test::text_of;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr double kHome = 1000;

std::string in_path(const std::string& program) {
  for (const char* folder : {"/usr/bin/", "/usr/local/bin/", "/bin/"}) {
    if (std::filesystem::exists(folder + program)) return folder + program;
  }
  return "";
}

/// A machine file and what belongs to it.
class SimTest : public testing::Test {
 protected:
  SimTest() { test::write_file(printer, test::to_bytes(kSmallMachine)); }
  TemporaryFolder folder;
  std::string printer = folder / "small.toml";
  RegisterMap map = *test::machine_of(kSmallMachine).modbus;
};

/// A client of libmodbus.
class Client {
 public:
  explicit Client(int port) : context_(modbus_new_tcp("127.0.0.1", port)) {
    modbus_set_response_timeout(context_, 5, 0);
    modbus_set_slave(context_, 1);
    if (modbus_connect(context_) != 0) throw std::runtime_error("no connection");
  }
  ~Client() {
    modbus_close(context_);
    modbus_free(context_);
  }
  modbus_t* get() const { return context_; }

  /// Set-points out, status in, at once. Nothing: `error` says why.
  std::optional<Status> exchange(const RegisterMap& map, const SetPoints& s) {
    const auto out = encode(map, s);
    std::vector<std::uint16_t> in(static_cast<std::size_t>(map.read_count));
    if (modbus_write_and_read_registers(context_, map.write_address, map.write_count, out.data(),
                                        map.read_address, map.read_count, in.data()) < 0) {
      error = errno;
      return std::nullopt;
    }
    return decode_status(map, in);
  }
  int error = 0;

 private:
  modbus_t* context_;
};

SetPoints run_to(double target_um, double speed_um_s, double blue = 0, double uv = 0) {
  SetPoints s;
  s.command = Command::run;
  s.target_um = target_um;
  s.speed_um_s = speed_um_s;
  s.acceleration_um_s2 = 1000;
  s.blue_share = blue;
  s.uv_mw_cm2 = uv;
  return s;
}

std::vector<nlohmann::json> events_of(const std::string& path) {
  std::vector<nlohmann::json> all;
  std::istringstream lines(text_of(path));
  for (std::string line; std::getline(lines, line);) all.push_back(nlohmann::json::parse(line));
  return all;
}
std::vector<std::string> words(const std::string& path) {
  std::vector<std::string> all;
  for (const auto& e : events_of(path)) all.push_back(e.at("event"));
  return all;
}

// --- Usage

TEST_F(SimTest, SaysWhatIsWrong) {
  const std::string sim = SLICECORR_BIN_DIR "/printer-sim";
  const auto refuses = [&](std::vector<std::string> options, const std::string& message) {
    options.insert(options.begin(), sim);
    const auto r = run_program(options);
    EXPECT_EQ(r.exit_code, 2) << message;
    EXPECT_THAT(r.err, HasSubstr(message));
    EXPECT_EQ(r.out, "");
  };
  refuses({}, "--printer is required");
  refuses({"--printer", folder / "none.toml"}, "is not a file that can be read");
  refuses({"--printer", printer, "--listen", "127.0.0.1:0", "--fault", "dor"},
          "did you mean 'door'?");
  refuses({"--printer", printer, "--listen", "127.0.0.1:99999"}, "expected HOST:PORT");
  refuses({"--printer", printer, "--listen", "127.0.0.1:0", "-o", folder / "a.uvj", "--stack",
           folder / "none.uvj"},
          "none.uvj");
  refuses({"--printer", printer, "--listen", "127.0.0.1:0", "--time-rate", "0"}, "--time-rate");
  refuses({"--printer", printer, "--listen", "127.0.0.1:0", "--frames", "nowhere"},
          "expected unix:PATH or tcp:HOST:PORT");
  const std::string bare = folder / "bare.toml";
  test::write_file(bare, test::to_bytes(kSmallMachine.substr(0, kSmallMachine.find("[modbus]"))));
  refuses({"--printer", bare, "--listen", "127.0.0.1:0"}, "modbus: missing");
  const auto r = run_program({sim, "--printer", printer, "--listen", "/dev/null/none"});
  EXPECT_EQ(r.exit_code, 4);
  EXPECT_THAT(r.err, HasSubstr("can't be opened"));
}

TEST_F(SimTest, EndsAsItIsTold) {
  Sim one(printer);
  EXPECT_GT(one.port, 0);
  EXPECT_EQ(one.end(SIGTERM), 0);
  Sim two(printer);
  EXPECT_EQ(two.end(SIGINT), 130);
}

TEST_F(SimTest, ListensOnLoopbackOnlyUnlessTold) {
  Sim sim(printer, {"--listen", "127.0.0.1:0"});
  EXPECT_THAT(sim.modbus, HasSubstr("127.0.0.1:"));
  // The file's own port, on loopback.
  const std::string text = replaced(kSmallMachine, "port = 0", "port = 0\nhost = \"192.0.2.1\"");
  test::write_file(printer, test::to_bytes(text));
  Child child({SLICECORR_BIN_DIR "/printer-sim", "--printer", printer, "--quiet"});
  EXPECT_THAT(child.line(), HasSubstr("\"modbus\":\"127.0.0.1:"));
}

// --- libmodbus

TEST_F(SimTest, TakesSetPointsAndGivesStatusInOneExchange) {
  Sim sim(printer, {"--lockstep"});
  Client client(sim.port);
  SetPoints s = run_to(kHome + 100, 200, 0.5, 100);
  std::optional<Status> status;
  for (int i = 1; i <= 40; ++i) {  // each exchange is a cycle of 0.01 s
    s.sequence = static_cast<std::uint16_t>(40000 + i);
    ++s.heartbeat;
    status = client.exchange(map, s);
    ASSERT_TRUE(status) << modbus_strerror(client.error);
    EXPECT_EQ(status->sequence_echo, s.sequence);
    EXPECT_NEAR(*status->machine_time_s, 0.01 * i, 0.0005);
  }
  // The first exchange came at 0.01 s; 0.39 s later: 20 um of ramp, then 0.19 s of 200 um/s.
  EXPECT_NEAR(status->stage_um, kHome + 20 + 38, 0.01);
  EXPECT_NEAR(*status->stage_speed_um_s, 200, 0.001);
  EXPECT_NEAR(status->blue_measured, 0.5, 1e-6);
  EXPECT_NEAR(*status->uv_measured, 100, 0.001);
  EXPECT_EQ(status->state, MachineState::running);
}

TEST_F(SimTest, RefusesWhatItDoesNotHave) {
  Sim sim(printer);
  Client client(sim.port);
  std::array<std::uint16_t, 125> r{};
  const auto reads = [&](int address, int count) {
    return modbus_read_registers(client.get(), address, count, r.data()) == count ? 0 : errno;
  };
  const auto writes = [&](int address, std::vector<std::uint16_t> values) {
    return modbus_write_registers(client.get(), address, static_cast<int>(values.size()),
                                  values.data()) >= 0
               ? 0
               : errno;
  };
  EXPECT_EQ(reads(0, 16), 0);
  EXPECT_EQ(reads(100, 14), 0);
  EXPECT_EQ(reads(103, 1), 0);
  EXPECT_EQ(reads(15, 2), EMBXILADD);
  EXPECT_EQ(reads(99, 1), EMBXILADD);
  EXPECT_EQ(reads(113, 2), EMBXILADD);
  EXPECT_EQ(reads(65535, 1), EMBXILADD);
  EXPECT_EQ(writes(100, {1}), EMBXILADD);     // read only
  EXPECT_EQ(writes(102, {1, 2}), EMBXILADD);  // read only
  EXPECT_EQ(writes(14, {0, 0, 0}), EMBXILADD);
  EXPECT_EQ(modbus_write_register(client.get(), 101, 1), -1);
  EXPECT_EQ(errno, EMBXILADD);
  EXPECT_EQ(writes(2, {77}), EMBXILVAL);              // no command
  EXPECT_EQ(writes(4, {0x7fff, 0xffff}), EMBXILVAL);  // beyond the travel
  EXPECT_EQ(writes(4, {0xffff, 0xff00}), EMBXILVAL);  // below the window
  EXPECT_EQ(writes(10, {0x00ff, 0}), EMBXILVAL);      // more than the lamp gives
  EXPECT_EQ(writes(3, {60000}), EMBXILVAL);           // longer than its own watchdog
  // What was refused has left no trace.
  ASSERT_EQ(reads(0, 16), 0);
  EXPECT_EQ(r[2], 0);
  EXPECT_EQ(r[4] | r[5] | r[10], 0);
  EXPECT_EQ(r[3], 300);
  // Functions for coils and inputs are not there.
  std::uint8_t bits[8];
  EXPECT_EQ(modbus_read_bits(client.get(), 0, 1, bits), -1);
  EXPECT_EQ(errno, EMBXILFUN);
  EXPECT_EQ(modbus_read_input_registers(client.get(), 100, 1, r.data()), -1);
  EXPECT_EQ(errno, EMBXILFUN);
  // Another unit is not here.
  modbus_set_slave(client.get(), 9);
  EXPECT_EQ(reads(0, 1), EMBXGTAR);
}

TEST_F(SimTest, ServesSeveralAtOnce) {
  Sim sim(printer, {"--lockstep"});
  std::vector<std::unique_ptr<Client>> clients;
  for (int i = 0; i < 8; ++i) clients.push_back(std::make_unique<Client>(sim.port));
  std::vector<std::thread> readers;
  std::vector<int> good(clients.size(), 0);
  for (std::size_t i = 1; i < clients.size(); ++i) {
    readers.emplace_back([&, i] {
      for (int k = 0; k < 200; ++k) {
        std::array<std::uint16_t, 14> r{};
        good[i] += modbus_read_registers(clients[i]->get(), 100, 14, r.data()) == 14;
      }
    });
  }
  SetPoints s = run_to(kHome + 1000, 200, 1);
  for (int k = 1; k <= 200; ++k) {
    ++s.heartbeat;
    ++s.sequence;
    const auto status = clients[0]->exchange(map, s);
    ASSERT_TRUE(status);
    EXPECT_EQ(status->sequence_echo, s.sequence);
    // Who only looks on lets no time pass.
    EXPECT_NEAR(*status->machine_time_s, 0.01 * k, 0.0005);
  }
  for (auto& r : readers) r.join();
  for (std::size_t i = 1; i < clients.size(); ++i) EXPECT_EQ(good[i], 200);
}

TEST_F(SimTest, WatchdogActsWhenTheClientIsKilled) {
  const std::string log = folder / "events.jsonl";
  // In real time; nothing here waits longer than the watchdog takes.
  Sim sim(printer, {"--record-events", log});
  {
    Client client(sim.port);
    SetPoints s = run_to(kHome + 1000, 100, 1, 100);
    for (int k = 0; k < 3; ++k) {
      ++s.heartbeat;
      ASSERT_TRUE(client.exchange(map, s));
    }
  }  // gone without a word
  Client other(sim.port);
  std::array<std::uint16_t, 14> r{};
  do {
    ASSERT_EQ(modbus_read_registers(other.get(), 100, 14, r.data()), 14);
  } while (r[1] != 3);  // fault
  const Status status = decode_status(map, {r.begin(), r.end()});
  EXPECT_EQ(status.blue_measured, 0);
  EXPECT_EQ(*status.uv_measured, 0);
  EXPECT_TRUE(status.watchdog_tripped);
  EXPECT_EQ(sim.end(), 0);
  EXPECT_THAT(words(log), ElementsAre("run", "uv on", "blue on", "stage moves", "watchdog",
                                      "blue off", "uv off", "fault", "stage stops"));
}

TEST_F(SimTest, InLockstepTheWatchdogActsWhenNobodyIsLeft) {
  const std::string log = folder / "events.jsonl";
  Sim sim(printer, {"--record-events", log, "--lockstep"});
  {
    Client client(sim.port);
    ASSERT_TRUE(client.exchange(map, run_to(kHome + 1000, 100, 1)));
  }
  // Without anybody who asks.
  EXPECT_TRUE(test::wait_until([&] { return text_of(log).find("fault") != std::string::npos; }));
  EXPECT_EQ(sim.end(), 0);
  const auto events = events_of(log);
  ASSERT_GE(events.size(), 4);
  EXPECT_EQ(events[3].at("event"), "watchdog");
  EXPECT_NEAR(events[3].at("at_s").get<double>(), 0.31, 1e-9);
}

// --- Faults of the wire

TEST_F(SimTest, FaultsOfTheWire) {
  Sim sim(printer, {"--lockstep", "--fault", "drop=2@0.03s", "--fault", "wrong-reply@0.06s",
                    "--fault", "late-reply=0.1@0.08s", "--fault", "disconnect@0.1s"});
  auto client = std::make_unique<Client>(sim.port);
  modbus_set_response_timeout(client->get(), 0, 50000);
  SetPoints s;
  std::vector<int> failed;
  for (int k = 1; k <= 12; ++k) {
    ++s.sequence;
    ++s.heartbeat;
    const auto status = client->exchange(map, s);
    if (!status) {
      failed.push_back(k);
      client = std::make_unique<Client>(sim.port);
      modbus_set_response_timeout(client->get(), 0, 50000);
      continue;
    }
    EXPECT_EQ(status->sequence_echo, s.sequence);
  }
  EXPECT_THAT(failed, ElementsAre(3, 4, 6, 8, 10));
  // What was not answered was carried out: the sequence goes on, and so does time.
  std::array<std::uint16_t, 14> r{};
  ASSERT_EQ(modbus_read_registers(client->get(), 100, 14, r.data()), 14);
  EXPECT_EQ(r[0], 12);
  EXPECT_EQ(r[13], 120);
}

TEST_F(SimTest, LateAnswersComeAndOthersDoNotWaitForThem) {
  Sim sim(printer, {"--lockstep", "--fault", "late-reply=0.3@0.01s"});
  Client slow(sim.port), quick(sim.port);
  SetPoints s;
  s.sequence = 1;
  std::optional<Status> late;
  std::thread waiting([&] { late = slow.exchange(map, s); });
  // Meanwhile others are served: the echo tells that the slow one has been carried out.
  std::array<std::uint16_t, 14> r{};
  do {
    ASSERT_EQ(modbus_read_registers(quick.get(), 100, 14, r.data()), 14);
  } while (r[0] != 1);
  s.sequence = 2;
  EXPECT_TRUE(quick.exchange(map, s));
  waiting.join();
  ASSERT_TRUE(late);  // as things are when it comes
  EXPECT_EQ(late->sequence_echo, 2);
}

// --- Peers

TEST_F(SimTest, MbpollReadsAndWritesOverTcp) {
  const std::string mbpoll = in_path("mbpoll");
  if (mbpoll.empty()) GTEST_SKIP() << "mbpoll is not installed";
  Sim sim(printer, {"--lockstep"});
  const auto poll = [&](std::vector<std::string> options, std::vector<std::string> values = {}) {
    std::vector<std::string> all{mbpoll, "-m", "tcp", "-a", "1", "-p", std::to_string(sim.port),
                                 "-0",   "-1"};
    all.insert(all.end(), options.begin(), options.end());
    all.push_back("127.0.0.1");
    if (!values.empty()) all.push_back("--");
    all.insert(all.end(), values.begin(), values.end());
    return run_program(all);
  };
  // 1000.00 um as two registers, most significant first: 100000 = 1 * 65536 + 34464.
  auto r = poll({"-r", "100", "-c", "4", "-t", "4:hex"});
  EXPECT_EQ(r.exit_code, 0) << r.out << r.err;
  EXPECT_THAT(r.out, AllOf(HasSubstr("[102]: \t0x0001"), HasSubstr("[103]: \t0x86A0")));
  // The same as mbpoll's own 32 bits.
  r = poll({"-r", "102", "-c", "1", "-t", "4:int", "-B"});
  EXPECT_THAT(r.out, HasSubstr("[102]: \t100000"));
  // Sequence, heartbeat, command.
  r = poll({"-r", "0", "-t", "4"}, {"7", "8", "2"});
  EXPECT_EQ(r.exit_code, 0) << r.out << r.err;
  r = poll({"-r", "100", "-c", "2", "-t", "4"});
  EXPECT_THAT(r.out, AllOf(HasSubstr("[100]: \t7"), HasSubstr("[101]: \t2")));
  // One register.
  r = poll({"-r", "2", "-t", "4"}, {"0"});
  EXPECT_EQ(r.exit_code, 0) << r.out << r.err;
  r = poll({"-r", "101", "-c", "1", "-t", "4"});
  EXPECT_THAT(r.out, HasSubstr("[101]: \t0"));
  // Running, and nobody left to feed the watchdog: it has acted when the next one looks.
  r = poll({"-r", "2", "-t", "4"}, {"1"});
  EXPECT_EQ(r.exit_code, 0) << r.out << r.err;
  r = poll({"-r", "101", "-c", "1", "-t", "4"});
  EXPECT_THAT(r.out, HasSubstr("[101]: \t3"));
  // Wrong addresses and values.
  EXPECT_THAT(poll({"-r", "50", "-c", "1", "-t", "4"}).err, HasSubstr("Illegal data address"));
  EXPECT_THAT(poll({"-r", "101", "-t", "4"}, {"2"}).err, HasSubstr("Illegal data address"));
  EXPECT_THAT(poll({"-r", "2", "-t", "4"}, {"99"}).err, HasSubstr("Illegal data value"));
}

TEST_F(SimTest, MbpollReadsAndWritesOverASerialLine) {
  const std::string mbpoll = in_path("mbpoll"), socat = in_path("socat");
  if (mbpoll.empty() || socat.empty()) GTEST_SKIP() << "mbpoll or socat is not installed";
  const std::string a = folder / "a", b = folder / "b";
  const Child line({socat, "pty,raw,echo=0,link=" + a, "pty,raw,echo=0,link=" + b});
  ASSERT_TRUE(
      test::wait_until([&] { return std::filesystem::exists(a) && std::filesystem::exists(b); }));
  Sim sim(printer, {"--listen", a});
  EXPECT_EQ(sim.modbus, a);
  const auto poll = [&](std::vector<std::string> options, std::vector<std::string> values = {}) {
    std::vector<std::string> all{mbpoll, "-m", "rtu", "-b", "115200", "-P",
                                 "none", "-0", "-1",  "-o", "5"};
    all.insert(all.end(), options.begin(), options.end());
    all.push_back(b);
    if (!values.empty()) all.push_back("--");
    all.insert(all.end(), values.begin(), values.end());
    return run_program(all);
  };
  auto r = poll({"-a", "1", "-r", "0", "-t", "4"}, {"7", "8", "2"});
  EXPECT_EQ(r.exit_code, 0) << r.out << r.err;
  r = poll({"-a", "1", "-r", "100", "-c", "2", "-t", "4"});
  EXPECT_THAT(r.out, AllOf(HasSubstr("[100]: \t7"), HasSubstr("[101]: \t2")));
  EXPECT_THAT(poll({"-a", "1", "-r", "50", "-c", "1", "-t", "4"}).err,
              HasSubstr("Illegal data address"));
  EXPECT_THAT(poll({"-a", "1", "-r", "2", "-t", "4"}, {"99"}).err, HasSubstr("Illegal data value"));
  // Noise on the line, then a request that is right.
  {
    std::ofstream noise(b, std::ios::binary);
    noise << std::string(37, '\x5a');
  }
  for (int tries = 0; tries < 20; ++tries) {
    r = poll({"-a", "1", "-r", "100", "-c", "1", "-t", "4"});
    if (r.exit_code == 0) break;
  }
  EXPECT_THAT(r.out, HasSubstr("[100]: \t7"));
  EXPECT_EQ(sim.end(), 0);
}

// --- What must not bring it down

class RawSocket {
 public:
  explicit RawSocket(int port) : socket_(connect_wire("tcp:127.0.0.1:" + std::to_string(port))) {
    const timeval timeout{5, 0};
    ::setsockopt(socket_.get(), SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
  }
  bool send(const std::vector<std::uint8_t>& bytes) {
    return ::send(socket_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL) ==
           static_cast<ssize_t>(bytes.size());
  }
  /// What is there; empty when the other end has closed.
  std::vector<std::uint8_t> receive() {
    std::vector<std::uint8_t> bytes(4096);
    const ssize_t n = ::recv(socket_.get(), bytes.data(), bytes.size(), 0);
    bytes.resize(n > 0 ? static_cast<std::size_t>(n) : 0);
    return bytes;
  }
  void drain() {
    std::array<std::uint8_t, 4096> bytes;
    while (::recv(socket_.get(), bytes.data(), bytes.size(), MSG_DONTWAIT) > 0) {
    }
  }

 private:
  WireSocket socket_;
};

TEST_F(SimTest, LengthsOfRequestsAreChecked) {
  Sim sim(printer);
  // Transaction 1, protocol 0, length, unit 1, then function and data.
  const auto ask = [&](std::vector<std::uint8_t> pdu) {
    RawSocket socket(sim.port);
    std::vector<std::uint8_t> adu{0, 1, 0, 0, 0, static_cast<std::uint8_t>(pdu.size() + 1), 1};
    adu.insert(adu.end(), pdu.begin(), pdu.end());
    EXPECT_TRUE(socket.send(adu));
    const auto answer = socket.receive();
    return answer.size() == 9 && (answer[7] & 0x80) != 0 ? answer[8] : 0;
  };
  EXPECT_EQ(ask({3, 0, 100, 0, 1}), 0);
  EXPECT_EQ(ask({3, 0, 100, 0}), 3);                          // too short
  EXPECT_EQ(ask({3, 0, 100, 0, 0}), 3);                       // none
  EXPECT_EQ(ask({3, 0, 100, 0, 126}), 3);                     // more than Modbus has
  EXPECT_EQ(ask({16, 0, 0, 0, 2, 4, 0, 0}), 3);               // says two, has one
  EXPECT_EQ(ask({16, 0, 0, 0, 1, 4, 0, 0}), 3);               // says one and four bytes
  EXPECT_EQ(ask({16, 0, 0, 0, 0, 0}), 3);                     // none
  EXPECT_EQ(ask({23, 0, 100, 0, 1, 0, 0, 0, 1, 2}), 3);       // no values
  EXPECT_EQ(ask({23, 0, 100, 0, 1, 0, 0, 0, 122, 244}), 3);   // more than function 23 writes
  EXPECT_EQ(ask({23, 0, 50, 0, 1, 0, 0, 0, 1, 2, 0, 0}), 2);  // reads what is not there
  EXPECT_EQ(ask({6, 0, 0}), 3);
  EXPECT_EQ(ask({6, 0, 0, 0, 1}), 0);
  EXPECT_EQ(ask({43, 14, 1, 0}), 1);
  EXPECT_EQ(ask({99}), 1);
  // Broken heads end the connection.
  for (const auto& head : {std::vector<std::uint8_t>{0, 1, 0, 1, 0, 6, 1, 3, 0, 100, 0, 1},
                           std::vector<std::uint8_t>{0, 1, 0, 0, 0, 1, 1, 3, 0, 100, 0, 1},
                           std::vector<std::uint8_t>{0, 1, 0, 0, 255, 255, 1, 3, 0, 100, 0, 1}}) {
    RawSocket socket(sim.port);
    EXPECT_TRUE(socket.send(head));
    EXPECT_TRUE(socket.receive().empty());
  }
  // Byte by byte it is one request, too.
  RawSocket socket(sim.port);
  for (const std::uint8_t byte : {0, 9, 0, 0, 0, 6, 1, 3, 0, 100, 0, 1}) {
    EXPECT_TRUE(socket.send({byte}));
  }
  const auto answer = socket.receive();
  ASSERT_EQ(answer.size(), 11);
  EXPECT_EQ(answer[1], 9);
}

TEST_F(SimTest, NoRequestBringsItDown) {
  Sim sim(printer, {"--lockstep"});
  std::mt19937 random(20261121);
  const auto pick = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  auto socket = std::make_unique<RawSocket>(sim.port);
  const std::array<int, 9> functions{3, 6, 16, 23, 23, 1, 4, 22, 43};
  for (int i = 0; i < 20000; ++i) {
    std::vector<std::uint8_t> pdu{static_cast<std::uint8_t>(
        pick(8) == 0 ? pick(256) : functions[static_cast<std::size_t>(pick(9))])};
    // Addresses near those that are there, counts near those that fit.
    const auto put = [&](int value) {
      pdu.push_back(static_cast<std::uint8_t>(value >> 8));
      pdu.push_back(static_cast<std::uint8_t>(value));
    };
    put(pick(3) == 0 ? pick(65536) : pick(120));
    put(pick(3) == 0 ? pick(65536) : pick(20));
    if (pdu[0] == 23) {
      put(pick(20));
      put(pick(20));
    }
    if (pdu[0] == 16 || pdu[0] == 23) {
      const int bytes = 2 * (pdu[pdu[0] == 23 ? 8 : 4]);
      pdu.push_back(static_cast<std::uint8_t>(pick(4) == 0 ? pick(256) : bytes));
      for (int k = 0; k < bytes && k < 240; ++k) {
        pdu.push_back(static_cast<std::uint8_t>(pick(3) == 0 ? pick(256) : 0));
      }
    }
    if (pick(5) == 0) pdu.resize(static_cast<std::size_t>(pick(static_cast<int>(pdu.size()) + 1)));
    std::vector<std::uint8_t> adu{
        0, static_cast<std::uint8_t>(i), 0, 0, 0, static_cast<std::uint8_t>(pdu.size() + 1), 1};
    adu.insert(adu.end(), pdu.begin(), pdu.end());
    for (int k = pick(20) == 0 ? 1 + pick(3) : 0; k > 0; --k) {
      adu[static_cast<std::size_t>(pick(static_cast<int>(adu.size())))] =
          static_cast<std::uint8_t>(pick(256));
    }
    if (pick(50) == 0) adu.resize(static_cast<std::size_t>(pick(static_cast<int>(adu.size()))));
    if (!socket->send(adu) || pick(200) == 0) socket = std::make_unique<RawSocket>(sim.port);
    socket->drain();
  }
  ASSERT_TRUE(test::runs(sim));
  Client client(sim.port);
  std::array<std::uint16_t, 14> r{};
  EXPECT_EQ(modbus_read_registers(client.get(), 100, 14, r.data()), 14);
  EXPECT_EQ(sim.end(), 0);
}

// --- The frame wire

constexpr double kWaitS = 20;

WireHello hello_for(const Machine& machine, bool lockstep) {
  WireHello hello;
  hello.setup.printer = machine.printer;
  hello.setup.resin = load_resin(SLICECORR_DB_DIR "/figure-2-2.toml");
  hello.setup.process.speed_mm_h = 720;  // 200 um/s
  hello.layer_um = 50;
  hello.target_layers = 3;
  hello.slices = 3;
  hello.start_um = kHome;
  hello.m = 1;
  hello.lockstep = lockstep;
  return hello;
}
std::shared_ptr<Frame> frame_of(int number) {
  auto frame = std::make_shared<Frame>();
  frame->number = number;
  frame->width_px = 16;
  frame->height_px = 8;
  for (int i = 0; i < 128; ++i) frame->blue.push_back(static_cast<std::uint8_t>(i + number));
  return frame;
}
std::optional<WireMessage> ask(const WireSocket& socket, const WireMessage& message) {
  WireMessage answer;
  try {
    send_message(socket, message, kWaitS);
    if (!receive_message(socket, answer, kWaitS)) return std::nullopt;
  } catch (const DeviceError&) {
    return std::nullopt;  // reset while we spoke
  }
  return answer;
}
WireMessage tick(double at_s) {
  WireMessage m;
  m.kind = WireKind::tick;
  m.at_s = at_s;
  return m;
}

TEST_F(SimTest, ImagesAppearAtTheirTimeInLockstep) {
  const Machine machine = test::machine_of(kSmallMachine);
  for (const std::string& where : {std::string("tcp:127.0.0.1:0"), "unix:" + (folder / "frames")}) {
    Sim sim(printer, {"--lockstep", "--frames", where});
    const WireSocket display = connect_wire(sim.frames);
    ASSERT_TRUE(ask(display, message_of(hello_for(machine, true))));
    auto answer = ask(display, tick(0.25));
    ASSERT_TRUE(answer);
    EXPECT_DOUBLE_EQ(answer->at_s, 0.25);
    answer = ask(display, message_of(frame_of(4).get(), 0.3125));
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->number, 4);
    EXPECT_DOUBLE_EQ(answer->at_s, 0.3125);
    EXPECT_EQ(answer->count, 1);
    answer = ask(display, message_of(nullptr, 0.2));  // past: now
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->number, -1);
    EXPECT_DOUBLE_EQ(answer->at_s, 0.3125);
    EXPECT_EQ(answer->count, 2);
    // Once there were ticks, exchanges let no time pass.
    Client client(sim.port);
    const auto status = client.exchange(map, SetPoints{});
    ASSERT_TRUE(status);
    EXPECT_NEAR(*status->machine_time_s, 0.3125, 0.0006);
  }
}

TEST_F(SimTest, WhatIsWrongOnTheFrameWireEndsTheConnectionOnly) {
  const Machine machine = test::machine_of(kSmallMachine);
  Sim sim(printer, {"--lockstep", "--frames", "tcp:127.0.0.1:0"});
  const auto port = std::stoi(sim.frames.substr(sim.frames.rfind(':') + 1));
  const WireMessage hello = message_of(hello_for(machine, true));
  const auto greeted = [&] {
    WireSocket display = connect_wire(sim.frames);
    EXPECT_TRUE(ask(display, hello));
    return display;
  };
  EXPECT_FALSE(ask(connect_wire(sim.frames), tick(1)));                                // no hello
  EXPECT_FALSE(ask(connect_wire(sim.frames), message_of(hello_for(machine, false))));  // real time
  EXPECT_FALSE(ask(greeted(), hello));                                                 // twice
  EXPECT_FALSE(ask(greeted(), tick(1e9)));                                             // for years
  auto large = frame_of(1);
  large->width_px = 17;
  large->blue.resize(17 * 8);
  EXPECT_FALSE(ask(greeted(), message_of(large.get(), 0)));
  auto uv = frame_of(1);
  uv->uv.assign(128, 1);  // this machine's UV lamp is not patterned
  EXPECT_FALSE(ask(greeted(), message_of(uv.get(), 0)));
  WireMessage reply;
  reply.kind = WireKind::answer;
  EXPECT_FALSE(ask(greeted(), reply));
  WireMessage broken = hello;
  broken.payload.resize(broken.payload.size() / 2);
  EXPECT_FALSE(ask(connect_wire(sim.frames), broken));

  // Bytes of all kinds, many of them with a right beginning.
  std::mt19937 random(7);
  for (int i = 0; i < 300; ++i) {
    std::vector<std::uint8_t> bytes(1 + random() % 200);
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
    if (i % 2 == 0 && bytes.size() > 8) {
      const std::array<std::uint8_t, 8> head{
          'S', 'C', 'F', 'W', 1, 0, static_cast<std::uint8_t>(1 + random() % 4), 0};
      std::copy(head.begin(), head.end(), bytes.begin());
    }
    // A large size that never comes must not hold memory or the wire: the connection is closed.
    RawSocket socket(port);
    socket.send(bytes);
  }
  ASSERT_TRUE(test::runs(sim));
  const auto answer = ask(greeted(), message_of(frame_of(2).get(), 0.5));
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->number, 2);
  EXPECT_EQ(sim.end(), 0);
}

TEST_F(SimTest, FaultsOfTheDisplay) {
  const Machine machine = test::machine_of(kSmallMachine);
  Sim sim(printer,
          {"--lockstep", "--frames", "tcp:127.0.0.1:0", "--fault", "late-frame=0.02@frame:1",
           "--fault", "freeze-display@frame:3", "--fault", "display-gone@1s"});
  const WireSocket display = connect_wire(sim.frames);
  ASSERT_TRUE(ask(display, message_of(hello_for(machine, true))));
  auto answer = ask(display, message_of(frame_of(1).get(), 0.1));
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->number, 1);
  EXPECT_NEAR(answer->at_s, 0.12, 1e-12);  // what really happened
  answer = ask(display, message_of(frame_of(2).get(), 0.2));
  EXPECT_EQ(answer->at_s, 0.2);
  answer = ask(display, message_of(frame_of(3).get(), 0.3));
  EXPECT_EQ(answer->number, 2);
  EXPECT_EQ(answer->count, 2);
  EXPECT_FALSE(ask(display, message_of(frame_of(4).get(), 1.5)));
}

// --- The record

TEST_F(SimTest, RecordsWhatWasShownAndLit) {
  const Machine machine = test::machine_of(kSmallMachine);
  const std::string shown = folder / "shown.uvj", log = folder / "events.jsonl";
  const auto print = [&] {
    Sim sim(printer,
            {"--lockstep", "--frames", "tcp:127.0.0.1:0", "-o", shown, "--record-events", log});
    const WireSocket display = connect_wire(sim.frames);
    EXPECT_TRUE(ask(display, message_of(hello_for(machine, true))));
    Client client(sim.port);
    // Slices of 50 um at 200 um/s: 0.25 s each. The stage ramps over 20 um within the first.
    SetPoints s = run_to(kHome + 1000, 200, 1);
    int next = 0;
    for (int cycle = 0; cycle < 100; ++cycle) {
      EXPECT_TRUE(ask(display, tick(cycle * 0.01)));
      ++s.heartbeat;
      ++s.sequence;
      const auto status = client.exchange(map, s);
      EXPECT_TRUE(status);
      if (!status) return;
      // Frame n when the stage passes 50 n: at 0.2 + (50 n - 20) / 200 s.
      const double due = next == 0 ? 0 : 0.1 + 0.25 * next;
      if (next < 3 && due < (cycle + 1) * 0.01) {
        const auto answer = ask(display, message_of(frame_of(next).get(), due));
        EXPECT_TRUE(answer);
        EXPECT_DOUBLE_EQ(answer->at_s, std::max(due, cycle * 0.01));
        ++next;
      }
      if (next == 3 && cycle * 0.01 > 0.85) s.blue_share = 0;
    }
    EXPECT_EQ(sim.end(), 0);
  };
  print();
  const StackInfo info = StackReader::read_info(shown);
  ASSERT_EQ(info.kind, StackKind::recorded);
  EXPECT_EQ(info.grid.layers, 3);
  ASSERT_TRUE(info.recording);
  ASSERT_EQ(info.recording->slices(), 4);  // light went on for a moment after the third
  const auto parts = info.recording->of(1);
  ASSERT_EQ(parts.size(), 1);
  EXPECT_EQ(parts[0].image, 1);
  EXPECT_NEAR(parts[0].light, 1, 1e-9);
  EXPECT_NEAR(parts[0].speed_um_s, 200, 1e-6);
  EXPECT_NEAR(parts[0].from_um, 50, 1e-6);
  EXPECT_NEAR(parts[0].to_um, 100, 1e-6);
  // The first slice has the time of the ramp on top: 0.35 s for 0.25 s.
  double light = 0;
  for (const auto& p : info.recording->of(0)) light += p.light;
  EXPECT_NEAR(light, 0.35 / 0.25, 1e-9);
  // The images are those that were sent.
  const StackReader reader(shown, folder / "");
  std::uint64_t sum = 0;
  for (int n = 0; n < 3; ++n) {
    for (int i = 0; i < 128; ++i) sum += static_cast<std::uint8_t>(i + n);
  }
  EXPECT_EQ(reader.pixel_sum(), sum);
  // In lockstep the same print is the same record, byte for byte.
  const std::string first = text_of(shown), first_log = text_of(log);
  print();
  EXPECT_EQ(text_of(shown), first);
  EXPECT_EQ(text_of(log), first_log);
}

TEST_F(SimTest, WithoutAPrintThereIsNoRecord) {
  const std::string shown = folder / "shown.uvj";
  Sim sim(printer, {"-o", shown, "--frames", "tcp:127.0.0.1:0"});
  EXPECT_EQ(sim.end(SIGINT), 130);
  EXPECT_FALSE(std::filesystem::exists(shown));
}

TEST_F(SimTest, TimeMayPassFaster) {
  Sim sim(printer, {"--time-rate", "1000"});
  Client client(sim.port);
  std::array<std::uint16_t, 14> r{};
  const auto begin = std::chrono::steady_clock::now();
  double machine_s = 0;
  do {
    ASSERT_EQ(modbus_read_registers(client.get(), 100, 14, r.data()), 14);
    machine_s = *decode_status(map, {r.begin(), r.end()}).machine_time_s;
  } while (machine_s < 100);
  const std::chrono::duration<double> real = std::chrono::steady_clock::now() - begin;
  EXPECT_GT(machine_s, 900 * real.count());
}

}  // namespace
}  // namespace slicecorr::bridge
