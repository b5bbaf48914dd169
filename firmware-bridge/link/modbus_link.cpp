// The client end of Modbus.

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
#include <cerrno>
#include <cmath>
#include <cstring>
#include <vector>

#include "slicecorr/bridge/link.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

/// Between two attempts to connect, in exchanges: 0, 1, 2, 4 ... Exchanges and not seconds, so that
/// it is the same in lockstep.
constexpr int most_skipped = 16;

struct FreeContext {
  void operator()(modbus_t* c) const { modbus_free(c); }
};

class ModbusLink final : public Link {
 public:
  ModbusLink(const RegisterMap& map, const Limits& limits)
      : map_(map), runs_(write_runs(map)), limits_(limits) {
    if (map_.transport == Transport::tcp) {
      look_up();
      context_.reset(modbus_new_tcp("127.0.0.1", map_.port));  // it never connects by itself
    } else {
      context_.reset(modbus_new_rtu(map_.device.c_str(), map_.baud, map_.parity, 8, 1));
    }
    if (!context_) throw InputError("modbus", "", modbus_strerror(errno));
    modbus_t* const c = context_.get();
    if (modbus_set_slave(c, map_.unit) != 0) {
      throw InputError("modbus", "unit", fmt::format("{} is no unit", map_.unit));
    }
    modbus_set_error_recovery(c, MODBUS_ERROR_RECOVERY_NONE);
    const auto us =
        static_cast<std::uint32_t>(std::clamp(limits_.response_timeout_s, 1e-3, 10.0) * 1e6);
    modbus_set_response_timeout(c, us / 1000000, us % 1000000);
    modbus_set_byte_timeout(c, us / 1000000, us % 1000000);
  }
  ~ModbusLink() override { disconnect(); }

  std::optional<Status> exchange(const SetPoints& set_points) override {
    if (!connect()) return std::nullopt;
    modbus_t* const c = context_.get();
    // A reply that comes late would else be taken for the next one for ever.
    modbus_flush(c);
    const std::vector<std::uint16_t> written = encode(map_, set_points);
    if (map_.exchange == Exchange::fc23) {
      std::vector<std::uint16_t> read(static_cast<std::size_t>(map_.read_count));
      const int got =
          modbus_write_and_read_registers(c, map_.write_address, map_.write_count, written.data(),
                                          map_.read_address, map_.read_count, read.data());
      return take(got, read);
    }
    return write_all(written) ? read_status() : take(-1, {});
  }

  std::optional<Status> look() override { return connect() ? read_status() : std::nullopt; }

  std::string last_error() const override { return error_; }

 private:
  void look_up() {
    addrinfo hints{};
    hints.ai_family = AF_UNSPEC;
    hints.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    const int code =
        getaddrinfo(map_.host.c_str(), std::to_string(map_.port).c_str(), &hints, &found);
    if (code != 0) {
      throw InputError("modbus", "host",
                       fmt::format("'{}' is not found: {}", map_.host, gai_strerror(code)));
    }
    std::memcpy(&address_, found->ai_addr, found->ai_addrlen);
    address_size_ = found->ai_addrlen;
    freeaddrinfo(found);
  }

  std::optional<Status> read_status() {
    modbus_flush(context_.get());
    std::vector<std::uint16_t> read(static_cast<std::size_t>(map_.read_count));
    const auto ask =
        map_.exchange == Exchange::fc16_fc4 ? modbus_read_input_registers : modbus_read_registers;
    return take(ask(context_.get(), map_.read_address, map_.read_count, read.data()), read);
  }

  /// What was read, or why not; then the connection is made anew.
  std::optional<Status> take(int got, const std::vector<std::uint16_t>& read) {
    if (got != map_.read_count) {
      fail(got < 0 ? modbus_strerror(errno) : "an answer of the wrong length");
      return std::nullopt;
    }
    failures_ = 0;
    try {
      return decode_status(map_, read);
    } catch (const Error& e) {
      fail(e.what());
      return std::nullopt;
    }
  }
  void fail(const std::string& why) {
    error_ = where() + ": " + why;
    disconnect();
  }
  std::string where() const {
    return map_.transport == Transport::rtu ? map_.device
                                            : fmt::format("{}:{}", map_.host, map_.port);
  }

  /// A request for each run of registers; false, with errno, at the first that fails.
  bool write_all(const std::vector<std::uint16_t>& written) {
    for (const RegisterRun& run : runs_) {
      modbus_flush(context_.get());
      const int got = modbus_write_registers(context_.get(), run.address, run.count,
                                             written.data() + (run.address - map_.write_address));
      if (got == run.count) continue;
      if (got >= 0) errno = EMBBADDATA;
      return false;
    }
    return true;
  }

  /// Goes on with connecting; true when connected.
  bool connect() {
    if (connected_) return true;
    if (descriptor_ < 0) {
      if (skip_ > 0) {
        --skip_;
        return false;
      }
      skip_ = std::min(most_skipped, failures_ == 0 ? 0 : 1 << std::min(failures_ - 1, 8));
      ++failures_;
      if (map_.transport == Transport::rtu) {
        if (modbus_connect(context_.get()) != 0) {
          error_ = where() + ": " + modbus_strerror(errno);
          return false;
        }
        return connected_ = true;
      }
      descriptor_ =
          ::socket(address_.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, IPPROTO_TCP);
      if (descriptor_ < 0) {
        error_ = std::strerror(errno);
        return false;
      }
      const int on = 1;
      ::setsockopt(descriptor_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
      if (::connect(descriptor_, reinterpret_cast<const sockaddr*>(&address_), address_size_) !=
              0 &&
          errno != EINPROGRESS) {
        return refuse(errno);
      }
    }
    pollfd p{descriptor_, POLLOUT, 0};
    const int wait_ms =
        static_cast<int>(std::ceil(std::clamp(limits_.response_timeout_s, 1e-3, 10.0) * 1e3));
    const int ready = ::poll(&p, 1, wait_ms);
    if (ready == 0 || (ready < 0 && errno == EINTR)) {
      // The next exchange looks again, for a while.
      if (++waited_ > most_skipped) return refuse(ETIMEDOUT);
      error_ = where() + ": does not take the connection";
      return false;
    }
    int code = 0;
    socklen_t size = sizeof code;
    ::getsockopt(descriptor_, SOL_SOCKET, SO_ERROR, &code, &size);
    if (ready < 0 || code != 0) return refuse(ready < 0 ? errno : code);
    ::fcntl(descriptor_, F_SETFL, ::fcntl(descriptor_, F_GETFL) & ~O_NONBLOCK);
    modbus_set_socket(context_.get(), descriptor_);
    waited_ = 0;
    return connected_ = true;
  }

  bool refuse(int code) {
    error_ = where() + ": " + std::strerror(code);
    ::close(descriptor_);
    descriptor_ = -1;
    waited_ = 0;
    return false;
  }

  void disconnect() {
    if (map_.transport == Transport::rtu) {
      if (connected_) modbus_close(context_.get());
    } else if (descriptor_ >= 0) {
      ::close(descriptor_);
      modbus_set_socket(context_.get(), -1);
    }
    descriptor_ = -1;
    connected_ = false;
    waited_ = 0;
    skip_ = 0;
  }

  const RegisterMap map_;
  const std::vector<RegisterRun> runs_;
  const Limits limits_;
  std::unique_ptr<modbus_t, FreeContext> context_;
  sockaddr_storage address_{};
  socklen_t address_size_ = 0;
  int descriptor_ = -1;  ///< of TCP; connecting or connected
  bool connected_ = false;
  int failures_ = 0, skip_ = 0, waited_ = 0;
  std::string error_ = "not connected yet";
};

}  // namespace

std::unique_ptr<Link> make_modbus_link(const RegisterMap& map, const Limits& limits) {
  return std::make_unique<ModbusLink>(map, limits);
}

}  // namespace slicecorr::bridge
