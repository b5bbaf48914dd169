// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "sim/modbus_server.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <modbus.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <functional>
#include <list>
#include <utility>
#include <vector>

#include "frames/wire.hpp"
#include "sim/registers.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {

namespace {

using Time = std::chrono::steady_clock;
using Bytes = std::vector<std::uint8_t>;

constexpr int kIdleMs = 5;
constexpr std::size_t kMostClients = 32;
constexpr std::size_t kTcpHeader = 7;  // transaction, protocol, length, unit

struct ContextDeleter {
  void operator()(modbus_t* context) const { modbus_free(context); }
};
using Context = std::unique_ptr<modbus_t, ContextDeleter>;

/// A request that is answered later.
struct Late {
  Bytes request;
  int exception = 0;
  Time::time_point at;
};

struct Client {
  WireSocket socket;
  Bytes input;
  std::optional<Late> late;
};

/// HOST:PORT, else a device.
std::optional<std::pair<std::string, std::string>> host_and_port(const std::string& where) {
  const auto colon = where.rfind(':');
  if (colon == std::string::npos || colon == 0 || where.find('/') != std::string::npos) {
    return std::nullopt;
  }
  std::string host = where.substr(0, colon), port = where.substr(colon + 1);
  if (port.empty() || port.size() > 5 || port.find_first_not_of("0123456789") != port.npos ||
      std::stoi(port) > 65535) {
    throw InputError(where, "", "is no address; expected HOST:PORT or the path of a device");
  }
  return std::pair(host, port);
}

}  // namespace

struct ModbusServer::Impl {
  Impl(const Machine& m, TimedModel& t) : machine(m), model(t), registers(m, *m.modbus, t) {
    const auto holding = registers.holding(), input = registers.input();
    mapping = modbus_mapping_new_start_address(
        0, 0, 0, 0, static_cast<unsigned>(registers.first_holding()),
        static_cast<unsigned>(holding.size()), static_cast<unsigned>(registers.first_input()),
        static_cast<unsigned>(input.size()));
    if (!mapping) throw std::bad_alloc();
  }
  ~Impl() { modbus_mapping_free(mapping); }

  const Machine& machine;
  TimedModel& model;
  Registers registers;
  modbus_mapping_t* mapping = nullptr;
  Context context;
  std::string address;
  WireSocket listener;  ///< TCP
  std::list<Client> clients;
  bool left = false;
  std::optional<Late> late;  ///< serial
  std::optional<Time::time_point> refuse_until;

  void listen_on(const std::string& host, const std::string& port) {
    WireListener made = listen_wire(fmt::format("tcp:{}:{}", host, port));
    listener = std::move(made.socket);
    ::fcntl(listener.get(), F_SETFL, O_NONBLOCK);
    address = made.address.substr(4);
    // The port of the context is never used: it only builds answers.
    context.reset(modbus_new_tcp("127.0.0.1", 502));
    if (!context) throw std::bad_alloc();
  }

  void open_line(const std::string& device) {
    const RegisterMap& map = *machine.modbus;
    context.reset(modbus_new_rtu(device.c_str(), map.baud, map.parity, 8, 1));
    const auto failed = [&](const char* what) {
      throw DeviceError(fmt::format("{}: {}: {}", device, what, modbus_strerror(errno)));
    };
    if (!context) failed("is no serial device");
    if (modbus_set_slave(context.get(), map.unit) != 0 || modbus_connect(context.get()) != 0) {
      failed("can't be opened");
    }
    // Half a request must not hold up the line.
    modbus_set_byte_timeout(context.get(), 0, 100000);
    address = device;
  }

  /// By libmodbus, from registers as they are now. False when the wire is broken.
  bool answer(const Bytes& request, int exception) {
    if (exception != 0) {
      return modbus_reply_exception(context.get(), request.data(),
                                    static_cast<unsigned>(exception)) >= 0;
    }
    const auto holding = registers.holding(), input = registers.input();
    std::copy(holding.begin(), holding.end(), mapping->tab_registers);
    std::copy(input.begin(), input.end(), mapping->tab_input_registers);
    return modbus_reply(context.get(), request.data(), static_cast<int>(request.size()), mapping) >=
           0;
  }

  /// Carries out and answers, or doesn't. False: the wire is to be closed.
  bool serve(const Bytes& request, std::size_t header, std::size_t trailer,
             std::optional<Late>& later) {
    const std::span<const std::uint8_t> all(request);
    const Registers::Reply outcome =
        registers.carry_out(all.subspan(header, all.size() - header - trailer));
    if (!outcome.fault) return answer(request, outcome.exception);
    const SimFault& fault = *outcome.fault;
    const auto after = [&](double seconds) {
      return Time::now() +
             std::chrono::duration_cast<Time::duration>(std::chrono::duration<double>(seconds));
    };
    if (fault.what == "late-reply") {
      later = Late{request, outcome.exception, after(fault.value)};
    } else if (fault.what == "wrong-reply") {
      return answer_wrongly(request);
    } else if (fault.what == "disconnect") {
      refuse_until = after(fault.value);
      return false;
    }
    return true;
  }

  /// TCP: the answer to another request. Serial: an answer whose checksum is wrong.
  bool answer_wrongly(const Bytes& request) {
    if (listener) {
      Bytes other = request;
      other[1] = static_cast<std::uint8_t>(other[1] ^ 0x55);
      return answer(other, 0);
    }
    const std::array<std::uint8_t, 7> wrong{request[0], request[1], 2, 0xde, 0xad, 0, 0};
    return ::write(modbus_get_socket(context.get()), wrong.data(), wrong.size()) >= 0;
  }

  bool refusing() {
    if (refuse_until && *refuse_until <= Time::now()) refuse_until.reset();
    return refuse_until.has_value();
  }

  void take_client() {
    WireSocket socket(::accept4(listener.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
    if (!socket || refusing() || clients.size() >= kMostClients) return;
    const int on = 1;
    ::setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    clients.push_back({std::move(socket), {}, {}});
  }

  /// Takes what has come and serves whole requests. False: the client is gone, or speaks something
  /// else.
  bool read(Client& client) {
    std::array<std::uint8_t, 1024> buffer;
    const ssize_t n = ::recv(client.socket.get(), buffer.data(), buffer.size(), MSG_DONTWAIT);
    if (n == 0) return false;
    if (n < 0) return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
    client.input.insert(client.input.end(), buffer.begin(), buffer.begin() + n);
    return serve_input(client);
  }
  bool serve_input(Client& client) {
    modbus_set_socket(context.get(), client.socket.get());
    Bytes& in = client.input;
    // One after the other: what waits for a late answer waits.
    while (!client.late && in.size() >= kTcpHeader) {
      const int protocol = in[2] << 8 | in[3], length = in[4] << 8 | in[5];
      if (protocol != 0 || length < 2 || length > MODBUS_TCP_MAX_ADU_LENGTH - 6) return false;
      const std::size_t size = 6 + static_cast<std::size_t>(length);
      if (in.size() < size) return true;
      const Bytes request(in.begin(), in.begin() + static_cast<std::ptrdiff_t>(size));
      in.erase(in.begin(), in.begin() + static_cast<std::ptrdiff_t>(size));
      const int unit = request[6];
      const bool ours = unit == machine.modbus->unit || unit == 0 || unit == 255;
      const bool good = ours ? serve(request, kTcpHeader, 0, client.late)
                             : answer(request, MODBUS_EXCEPTION_GATEWAY_TARGET);
      if (!good) return false;
    }
    return true;
  }

  bool send_late(Client& client) {
    if (!client.late || client.late->at > Time::now()) return true;
    const Late due = std::move(*client.late);
    client.late.reset();
    modbus_set_socket(context.get(), client.socket.get());
    return answer(due.request, due.exception) && serve_input(client);
  }

  void serve_tcp(const std::function<bool()>& idle) {
    std::vector<pollfd> waiting;
    while (idle()) {
      waiting.assign(1, {listener.get(), POLLIN, 0});
      for (const Client& c : clients) waiting.push_back({c.socket.get(), POLLIN, 0});
      ::poll(waiting.data(), waiting.size(), kIdleMs);
      std::size_t i = 1;
      for (auto c = clients.begin(); c != clients.end(); ++i) {
        bool good = waiting[i].revents == 0 || read(*c);
        good = good && send_late(*c);
        c = good ? std::next(c) : clients.erase(c);
      }
      if (refusing()) clients.clear();
      left = left || (waiting.size() > 1 && clients.empty());
      if (waiting[0].revents != 0) take_client();
    }
  }

  void serve_line(const std::function<bool()>& idle) {
    constexpr std::size_t checksum = 2;
    while (idle()) {
      pollfd line{modbus_get_socket(context.get()), POLLIN, 0};
      const int ready = ::poll(&line, 1, kIdleMs);
      if (late && late->at <= Time::now()) {
        const Late due = std::move(*late);
        late.reset();
        answer(due.request, due.exception);
      }
      if (ready <= 0) continue;
      if ((line.revents & POLLIN) == 0) {
        throw DeviceError(fmt::format("{}: the line is gone", address));
      }
      Bytes request(MODBUS_RTU_MAX_ADU_LENGTH);
      const int size = modbus_receive(context.get(), request.data());
      // Not for us, or not understood: others may speak on this line.
      if (size < 0) modbus_flush(context.get());
      if (size <= static_cast<int>(1 + checksum) || refusing()) continue;
      request.resize(static_cast<std::size_t>(size));
      serve(request, 1, checksum, late);
    }
  }
};

ModbusServer::ModbusServer(const std::string& where, const Machine& machine, TimedModel& model)
    : impl_(std::make_unique<Impl>(machine, model)) {
  if (const auto tcp = host_and_port(where)) {
    impl_->listen_on(tcp->first, tcp->second);
  } else {
    impl_->open_line(where);
  }
}
ModbusServer::~ModbusServer() = default;
const std::string& ModbusServer::address() const { return impl_->address; }
bool ModbusServer::busy() const { return !impl_->clients.empty(); }
bool ModbusServer::everybody_left() { return std::exchange(impl_->left, false); }
void ModbusServer::serve(const std::function<bool()>& idle) {
  if (impl_->listener) {
    impl_->serve_tcp(idle);
  } else {
    impl_->serve_line(idle);
  }
}

}  // namespace slicecorr::bridge
