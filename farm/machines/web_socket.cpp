// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "machines/web_socket.hpp"

#include <boost/asio/connect.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <deque>

#include "machines/http_calls.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/version.hpp"
#include "support/process/no_sigpipe.hpp"

namespace slicecorr::farm::detail {

namespace asio = boost::asio;
namespace beast = boost::beast;
using boost::system::error_code;
using Tcp = asio::ip::tcp;

struct WebSocket::Parts {
  Parts(std::string name, const std::atomic<bool>* flag) : where(std::move(name)), cancel(flag) {}
  std::string where;
  const std::atomic<bool>* cancel;
  asio::io_context io;
  beast::websocket::stream<beast::tcp_stream> stream{io};
  beast::flat_buffer buffer;
  std::deque<std::string> came;
  bool reading = false;
  std::optional<error_code> ended;

  /// Works until something holds, or the time is over.
  template <class Holds>
  bool run(Holds holds, double most_s) {
    using Steady = std::chrono::steady_clock;
    const NoSigpipe no_sigpipe;
    const auto until = Steady::now() + std::chrono::duration_cast<Steady::duration>(
                                           std::chrono::duration<double>(most_s));
    while (!holds()) {
      io.restart();
      const auto now = Steady::now();
      if (now >= until || (cancel && *cancel)) return holds();
      // In slices, so that who is told to end is not kept.
      io.run_one_for(std::min<Steady::duration>(until - now, kSlice));
    }
    return true;
  }
  /// Ends the connection, and waits until nothing under way refers to what goes.
  template <class Ended>
  void close(Ended over) {
    error_code ignored;
    beast::get_lowest_layer(stream).socket().close(ignored);
    cancel = nullptr;
    run(over, 1);
  }
  void read() {
    if (reading || ended) return;
    reading = true;
    stream.async_read(buffer, [this](error_code error, std::size_t) {
      reading = false;
      if (error) {
        ended = error;
        return;
      }
      came.push_back(beast::buffers_to_string(buffer.data()));
      buffer.consume(buffer.size());
      // A machine that sends without end fills no memory.
      if (came.size() > kMostWaiting) came.pop_front();
    });
  }
  [[noreturn]] void fail(const std::string& what) const {
    throw DeviceError(where + ": " + what +
                      (ended ? " (" + ended->message() + ")" : std::string()));
  }
  static constexpr std::size_t kMostWaiting = 1000;
  static constexpr auto kSlice = std::chrono::milliseconds(50);
};

WebSocket::WebSocket(const std::string& host, int port, double most_s,
                     const std::atomic<bool>* cancel)
    : parts_(std::make_unique<Parts>(host_text(host, port), cancel)) {
  Parts& p = *parts_;
  std::optional<error_code> done;
  const auto finish = [&](error_code error) { done = error; };
  const auto wait = [&](const char* what) {
    const bool in_time = p.run([&] { return done.has_value(); }, most_s);
    if (!in_time) {
      // What is under way refers to what goes with this call.
      p.close([&] { return done.has_value(); });
      p.fail(std::string(what) + " took too long");
    }
    if (*done) {
      p.ended = *done;
      p.fail(what);
    }
    done.reset();
  };
  // Names are looked up by the system, whose own limits hold.
  Tcp::resolver resolver(p.io);
  error_code error;
  const auto places = resolver.resolve(host, std::to_string(port), error);
  if (error) {
    p.ended = error;
    p.fail("has no address");
  }
  beast::get_lowest_layer(p.stream).expires_never();
  asio::async_connect(beast::get_lowest_layer(p.stream).socket(), places,
                      [&](error_code e, const Tcp::endpoint&) { finish(e); });
  wait("no connection");
  p.stream.read_message_max(kMostAnswerBytes);
  p.stream.set_option(
      beast::websocket::stream_base::decorator([](beast::websocket::request_type& request) {
        request.set(beast::http::field::user_agent, std::string("slicefarm/") + slicecorr::version);
      }));
  p.stream.async_handshake(p.where, "/websocket", finish);
  wait("no WebSocket");
  p.stream.text(true);
  p.read();
}

WebSocket::~WebSocket() {
  parts_->close([&] { return !parts_->reading; });
}

void WebSocket::send(const std::string& text, double most_s) {
  Parts& p = *parts_;
  if (p.ended) p.fail("the connection ended");
  std::optional<error_code> done;
  p.stream.async_write(asio::buffer(text), [&](error_code error, std::size_t) { done = error; });
  const bool in_time = p.run([&] { return done.has_value(); }, most_s);
  if (!in_time) {
    p.close([&] { return done.has_value(); });
    p.fail("takes nothing");
  }
  if (*done) {
    p.ended = *done;
    p.fail("the connection ended");
  }
}

std::optional<std::string> WebSocket::next(double most_s) {
  Parts& p = *parts_;
  p.read();
  p.run([&] { return !p.came.empty() || p.ended; }, most_s);
  if (p.came.empty()) {
    if (p.ended) p.fail("the connection ended");
    return std::nullopt;
  }
  std::string text = std::move(p.came.front());
  p.came.pop_front();
  p.read();
  return text;
}

}  // namespace slicecorr::farm::detail
