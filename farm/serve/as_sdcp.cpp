// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// One thread for connections and datagrams, one for the file that is being checked, one that looks at the
// real machine; what they share is behind one lock.

#include "slicecorr/farm/as_sdcp.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ip/udp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <deque>
#include <map>
#include <mutex>
#include <set>
#include <thread>

#include "machines/digest.hpp"
#include "machines/sdcp.hpp"
#include "serve/job_of_upload.hpp"
#include "serve/part_form.hpp"
#include "serve/uploads.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/token.hpp"
#include "slicecorr/version.hpp"
#include "support/http/guard.hpp"
#include "support/json/members.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace web = boost::beast::http;
using boost::system::error_code;
using detail::SdcpJson;
using slicecorr::detail::member_of, slicecorr::detail::text_in, slicecorr::detail::whole_in;
using Tcp = asio::ip::tcp;
using Udp = asio::ip::udp;

constexpr std::size_t kPartBytes = 1'048'576, kFormBytes = 16 << 10, kMessageBytes = 64 << 10;
constexpr std::size_t kMostConnections = 16, kMostWaiting = 64;
constexpr auto kStall = std::chrono::seconds(30);
constexpr auto kBetweenLooks = std::chrono::seconds(3);

std::string dumped(const SdcpJson& json) {
  return json.dump(-1, ' ', false, SdcpJson::error_handler_t::replace);
}

std::string taken() { return R"({"code":"000000","messages":null,"data":{},"success":true})"; }
std::string refused(int number) {
  return fmt::format(
      R"({{"code":"111111","messages":[{{"field":"common_field","message":{}}}],"data":null,"success":false}})",
      number);
}

}  // namespace

struct SdcpPrinter::Parts {
  Parts(const FarmFolder& farm, AsSdcpOptions given)
      : folder(farm),
        options(std::move(given)),
        machine(machine_named(farm, options.like.machine)),
        room(farm, machine, options.like.times) {}

  // --- what clients are told -----------------------------------------------------------------------

  /// The id that clients see: of this farm and machine, the same each time.
  std::string id() const { return detail::md5_hex(folder.root + "/" + machine.name).substr(0, 16); }

  SdcpJson attributes() {
    const std::scoped_lock lock(mutex);
    SdcpJson types = SdcpJson::array();
    for (std::string format : facts.formats.empty() ? formats_read_by(machine) : facts.formats) {
      for (char& c : format) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
      types.push_back(format);
    }
    const int width = machine.width_px > 0 ? machine.width_px : facts.width_px;
    const int height = machine.width_px > 0 ? machine.height_px : facts.height_px;
    return {{"Attributes",
             {{"Name", machine.name},
              {"MachineName", facts.model.empty() ? machine.printer : facts.model},
              {"BrandName", "slicecorr"},
              {"ProtocolVersion", "V3.0.0"},
              {"FirmwareVersion", version},
              {"MainboardID", id()},
              {"Resolution", fmt::format("{}x{}", width, height)},
              {"SupportFileType", types},
              {"Capabilities", SdcpJson::array({"FILE_TRANSFER", "PRINT_CONTROL"})}}},
            {"MainboardID", id()},
            {"TimeStamp", system_clock().wall_ms() / 1000},
            {"Topic", "sdcp/attributes/" + id()}};
  }

  SdcpJson status() {
    const std::scoped_lock lock(mutex);
    const MachineStatus& s = view.status;
    SdcpJson current = SdcpJson::array();
    if (checking)
      current = {2, 8};
    else if (!uuid.empty())
      current = {2};
    else
      current = {is_print(s.state) ? 1 : 0};
    int phase = 0;
    if (is_print(s.state)) {
      phase = s.state == MachineState::paused     ? 6
              : s.state == MachineState::pausing  ? 5
              : s.state == MachineState::stopping ? 7
                                                  : 3;
    }
    const auto ms = [](const std::optional<double>& seconds) {
      return static_cast<std::int64_t>(seconds.value_or(0) * 1000);
    };
    return {{"Status",
             {{"CurrentStatus", current},
              {"PrintInfo",
               {{"Status", phase},
                {"CurrentLayer", s.layer.value_or(0)},
                {"TotalLayer", s.layers.value_or(0)},
                {"CurrentTicks", ms(s.run_s)},
                {"TotalTicks", ms(s.run_s) + ms(s.left_s)},
                {"Filename", s.file},
                {"ErrorNumber", 0},
                {"TaskId", ""}}}}},
            {"MainboardID", id()},
            {"TimeStamp", system_clock().wall_ms() / 1000},
            {"Topic", "sdcp/status/" + id()}};
  }

  /// An error as machines push it: 1 the checksum, 2 the file.
  SdcpJson error_push(int code) const {
    return {{"Id", "slicecorr"},
            {"Data", {{"Data", {{"ErrorCode", code}}}, {"MainboardID", id()}}},
            {"Topic", "sdcp/error/" + id()}};
  }

  /// What becomes of a request: the answer's own data.
  SdcpJson act(int cmd, const SdcpJson& data) {
    const auto ack = [](int number) { return SdcpJson{{"Ack", number}}; };
    if (cmd == 0 || cmd == 1) return ack(0);
    // A start is said at the farm, by who has looked at the plate.
    if (cmd == 128) return ack(1);
    if (cmd == 129 || cmd == 130 || cmd == 131) return ack(steer(cmd) ? 0 : 1);
    if (cmd == 255) {
      const std::scoped_lock lock(mutex);
      if (checking) return ack(2);
      if (uuid.empty() || text_in(data, "Uuid") != uuid) return ack(1);
      drop_upload();
      return ack(0);
    }
    if (cmd == 258) {
      const std::scoped_lock lock(mutex);
      SdcpJson list = SdcpJson::array();
      for (const std::string& name : listed)
        list.push_back({{"name", "/local/" + name}, {"type", 1}});
      return {{"Ack", 0}, {"FileList", list}};
    }
    return ack(1);
  }

  bool steer(int cmd) {
    try {
      MachineTimes times = options.like.times;
      times.cancel = &stopping;
      MachineRoom now(folder, machine, times);
      if (cmd == 129) now.pause();
      if (cmd == 130) now.stop();
      if (cmd == 131) now.resume();
      const MachineView seen = now.look();
      const std::scoped_lock lock(mutex);
      view = seen;
      return true;
    } catch (const Error&) {
      return false;
    }
  }

  // --- files ---------------------------------------------------------------------------------------

  void drop_upload() {
    upload.reset();
    md5.reset();
    uuid.clear();
  }

  /// The answer to a part.
  std::string take_part(const detail::PartForm& form) {
    const std::int64_t offset = form.number("Offset"), total = form.number("TotalSize");
    const std::scoped_lock lock(mutex);
    const std::string whose = form.text("Uuid");
    if (checking || offset < 0) return refused(offset < 0 ? -1 : -4);
    if (total <= 0 || total > options.like.most_upload_bytes || whose.empty() ||
        whose.size() > 64 || form.bytes.empty() || form.bytes.size() > kPartBytes ||
        detail::clean_uploads(folder, 24 * 3600) > options.like.most_uploads_bytes) {
      return refused(-4);
    }
    try {
      if (offset == 0 && (whose != uuid || upload_bytes() == 0)) {
        drop_upload();
        upload = std::make_unique<detail::Upload>(folder, form.file_name);
        md5 = std::make_unique<detail::Md5>();
        uuid = whose;
        file_name = form.file_name;
        file_md5 = form.text("S-File-MD5");
        file_total = total;
      }
      if (whose != uuid || offset != upload_bytes() || total != file_total ||
          form.file_name != file_name) {
        return refused(-2);
      }
      upload->write(form.bytes.data(), form.bytes.size());
      md5->add(form.bytes.data(), form.bytes.size());
      last_part = std::chrono::steady_clock::now();
      if (upload_bytes() > file_total) {
        drop_upload();
        return refused(-2);
      }
    } catch (const http::ApiError&) {
      return refused(-3);
    } catch (const DeviceError&) {
      drop_upload();
      return refused(-3);
    }
    if (upload_bytes() == file_total) begin_check();
    return taken();
  }
  std::int64_t upload_bytes() const { return upload ? upload->bytes() : 0; }

  /// Under the lock. All of a file came: it is checked and queued apart, as boards do.
  void begin_check() {
    checking = true;
    if (checker.joinable()) checker.join();
    checker = std::thread([this] {
      int error = 0;
      std::string name;
      try {
        std::string part;
        {
          const std::scoped_lock lock(mutex);
          name = file_name;
          // Who sends no checksum wants none.
          if (!file_md5.empty() && md5->hex() != file_md5) error = 1;
          if (error == 0) part = upload->keep();
        }
        if (error == 0) {
          const SubmitReply reply =
              options.like.submit(detail::job_of_upload(machine, part, name), false, stopping);
          if (!detail::refusal_of(reply).empty()) error = 2;
        }
      } catch (const std::exception&) {
        error = 2;
      }
      const std::scoped_lock lock(mutex);
      drop_upload();
      if (error == 0 && listed.size() < 1000) listed.insert(name);
      // Told before the status is that of a machine at rest.
      if (error != 0) asio::post(io, [this, error] { tell_all(dumped(error_push(error))); });
      checking = false;
    });
  }

  // --- connections ---------------------------------------------------------------------------------

  class Session;
  void accept();
  void listen_udp();
  void tell_all(const std::string& text);
  bool is_client(const std::string& address) const {
    return std::find(options.clients.begin(), options.clients.end(), address) !=
           options.clients.end();
  }

  /// Looks at the real machine as long as this runs.
  void watch() {
    while (!stopping) {
      try {
        const MachineView seen = room.look();
        MachineFacts asked;
        if (seen.status.state != MachineState::unknown && facts.model.empty()) asked = room.facts();
        const std::scoped_lock lock(mutex);
        view = seen;
        if (!asked.model.empty()) facts = asked;
        // A sender that went away does not hold the place for ever.
        if (!checking && !uuid.empty() && std::chrono::steady_clock::now() - last_part > kStall) {
          drop_upload();
        }
      } catch (const Error&) {
        // What was seen before stays.
      }
      const auto until = std::chrono::steady_clock::now() + kBetweenLooks;
      while (!stopping && std::chrono::steady_clock::now() < until) {
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
      }
    }
  }

  FarmFolder folder;
  AsSdcpOptions options;
  MachineSpec machine;
  MachineRoom room;
  std::mutex mutex;
  MachineView view;
  MachineFacts facts;
  std::unique_ptr<detail::Upload> upload;
  std::unique_ptr<detail::Md5> md5;
  std::string uuid, file_name, file_md5;
  std::int64_t file_total = 0;
  std::chrono::steady_clock::time_point last_part;
  bool checking = false;
  std::thread checker;
  std::set<std::string> listed;  ///< that were queued since this began
  std::atomic<bool> stopping{false};
  asio::io_context io;
  Tcp::acceptor acceptor{io};
  Udp::socket udp{io};
  std::array<char, 2048> datagram{};
  Udp::endpoint caller;
  std::set<std::shared_ptr<Session>> sessions;
};

/// One connection: a request, or a WebSocket.
class SdcpPrinter::Parts::Session : public std::enable_shared_from_this<Session> {
 public:
  Session(Parts& parts, Tcp::socket socket) : parts_(parts), stream_(std::move(socket)) {
    parser_.body_limit(kPartBytes + kFormBytes);
    parser_.header_limit(kFormBytes);
  }
  void start() {
    beast::get_lowest_layer(stream_).expires_after(kStall);
    web::async_read(beast::get_lowest_layer(stream_), buffer_, parser_,
                    [self = shared_from_this()](error_code error, std::size_t) {
                      if (error) return self->end();
                      self->answer();
                    });
  }
  void push(const std::string& text) {
    if (!is_socket_) return;
    if (waiting_.size() >= kMostWaiting) return end();
    waiting_.push_back(text);
    write();
  }
  void end() {
    error_code ignored;
    beast::get_lowest_layer(stream_).socket().close(ignored);
    parts_.sessions.erase(shared_from_this());
  }

 private:
  void answer() {
    const auto& request = parser_.get();
    // Pages of a browser say where they come from; slicers do not.
    const bool page = request.find(web::field::origin) != request.end();
    if (!page && beast::websocket::is_upgrade(request) && request.target() == "/websocket") {
      return upgrade();
    }
    const bool part =
        request.method() == web::verb::post && request.target() == "/uploadFile/upload" && !page;
    response_.version(11);
    response_.keep_alive(false);
    response_.set(web::field::content_type, "application/json");
    response_.result(part   ? web::status::ok
                     : page ? web::status::forbidden
                            : web::status::not_found);
    if (part) {
      const auto form =
          detail::read_part_form(std::string(request[web::field::content_type]), request.body());
      response_.body() = form ? parts_.take_part(*form) : refused(-4);
    }
    response_.prepare_payload();
    web::async_write(beast::get_lowest_layer(stream_), response_,
                     [self = shared_from_this()](error_code, std::size_t) { self->end(); });
  }

  void upgrade() {
    beast::get_lowest_layer(stream_).expires_never();
    stream_.set_option(beast::websocket::stream_base::timeout::suggested(beast::role_type::server));
    stream_.read_message_max(kMessageBytes);
    stream_.async_accept(parser_.get(), [self = shared_from_this()](error_code error) {
      if (error) return self->end();
      self->is_socket_ = true;
      self->buffer_.consume(self->buffer_.size());
      self->read();
    });
  }

  void read() {
    stream_.async_read(buffer_, [self = shared_from_this()](error_code error, std::size_t) {
      if (error) return self->end();
      const std::string text = beast::buffers_to_string(self->buffer_.data());
      self->buffer_.consume(self->buffer_.size());
      self->take(text);
      self->read();
    });
  }

  void take(const std::string& text) {
    if (text == "ping") return push("pong");
    const SdcpJson message = detail::sdcp_json(text);
    const SdcpJson& data = member_of(message, "Data");
    const int cmd = whole_in(data, "Cmd", -1);
    if (cmd < 0) return;
    const SdcpJson answered = {{"Id", "slicecorr"},
                               {"Data",
                                {{"Cmd", cmd},
                                 {"Data", parts_.act(cmd, member_of(data, "Data"))},
                                 {"RequestID", text_in(data, "RequestID")},
                                 {"MainboardID", parts_.id()},
                                 {"TimeStamp", system_clock().wall_ms() / 1000}}},
                               {"Topic", "sdcp/response/" + parts_.id()}};
    push(dumped(answered));
    if (cmd == 0) push(dumped(parts_.status()));
    if (cmd == 1) push(dumped(parts_.attributes()));
  }

  void write() {
    if (writing_ || waiting_.empty()) return;
    writing_ = true;
    stream_.text(true);
    stream_.async_write(asio::buffer(waiting_.front()),
                        [self = shared_from_this()](error_code error, std::size_t) {
                          self->writing_ = false;
                          if (error) return self->end();
                          self->waiting_.pop_front();
                          self->write();
                        });
  }

  Parts& parts_;
  beast::websocket::stream<beast::tcp_stream> stream_;
  beast::flat_buffer buffer_;
  web::request_parser<web::string_body> parser_;
  web::response<web::string_body> response_;
  std::deque<std::string> waiting_;
  bool is_socket_ = false, writing_ = false;
};

void SdcpPrinter::Parts::accept() {
  acceptor.async_accept([this](error_code error, Tcp::socket socket) {
    if (stopping || error == asio::error::operation_aborted) return;
    error_code ignored;
    const auto from = socket.remote_endpoint(ignored);
    if (!error && !ignored && is_client(from.address().to_string()) &&
        sessions.size() < kMostConnections) {
      const auto session = std::make_shared<Session>(*this, std::move(socket));
      sessions.insert(session);
      session->start();
    }
    accept();
  });
}

void SdcpPrinter::Parts::listen_udp() {
  udp.async_receive_from(
      asio::buffer(datagram), caller, [this](error_code error, std::size_t size) {
        if (stopping || error == asio::error::operation_aborted) return;
        if (!error && std::string_view(datagram.data(), size) == "M99999" &&
            is_client(caller.address().to_string())) {
          const SdcpJson all = attributes();
          const SdcpJson& a = all["Attributes"];
          const SdcpJson answer = {{"Id", "slicecorr"},
                                   {"Data",
                                    {{"Name", a["Name"]},
                                     {"MachineName", a["MachineName"]},
                                     {"BrandName", a["BrandName"]},
                                     {"MainboardIP", options.like.host},
                                     {"MainboardID", id()},
                                     {"ProtocolVersion", "V3.0.0"},
                                     {"FirmwareVersion", a["FirmwareVersion"]}}}};
          error_code ignored;
          udp.send_to(asio::buffer(dumped(answer)), caller, 0, ignored);
        }
        listen_udp();
      });
}

void SdcpPrinter::Parts::tell_all(const std::string& text) {
  const auto all = sessions;
  for (const auto& session : all) session->push(text);
}

SdcpPrinter::SdcpPrinter(const FarmFolder& folder, AsSdcpOptions options)
    : parts_(std::make_unique<Parts>(folder, std::move(options))) {
  Parts& p = *parts_;
  error_code error;
  const auto address = asio::ip::make_address_v4(p.options.like.host, error);
  if (error) throw InputError(p.options.like.host + ": expected an IPv4 address");
  if (p.options.clients.empty()) {
    throw InputError("SDCP knows no login: expected the addresses of those who may send");
  }
  for (const std::string& client : p.options.clients) {
    asio::ip::make_address_v4(client, error);
    if (error) throw InputError(client + ": expected an IPv4 address");
  }
  detail::check_rule(p.machine);
  static_cast<void>(Queue(folder.database()));
  const auto bind = [&](auto& what, const auto& place) {
    what.open(place.protocol(), error);
    if (!error) what.bind(place, error);
    if (error)
      throw DeviceError(
          fmt::format("{}:{}: {}", place.address().to_string(), place.port(), error.message()));
  };
  p.acceptor.open(Tcp::v4(), error);
  p.acceptor.set_option(Tcp::acceptor::reuse_address(true), error);
  p.acceptor.close(error);
  bind(p.acceptor, Tcp::endpoint(address, static_cast<std::uint16_t>(p.options.like.port)));
  bind(p.udp, Udp::endpoint(address, static_cast<std::uint16_t>(p.options.udp_port)));
  p.acceptor.listen(16, error);
  if (error) throw DeviceError(p.options.like.host + ": " + error.message());
}

SdcpPrinter::~SdcpPrinter() {
  stop();
  if (parts_->checker.joinable()) parts_->checker.join();
}

int SdcpPrinter::port() const { return parts_->acceptor.local_endpoint().port(); }
int SdcpPrinter::udp_port() const { return parts_->udp.local_endpoint().port(); }

void SdcpPrinter::run() {
  Parts& p = *parts_;
  std::thread watcher([&] { p.watch(); });
  p.accept();
  p.listen_udp();
  if (!p.stopping) p.io.run();
  watcher.join();
  // What refers to connections goes before them.
  const auto all = p.sessions;
  for (const auto& session : all) session->end();
  p.io.restart();
  p.io.poll();
}

void SdcpPrinter::stop() {
  parts_->stopping = true;
  parts_->io.stop();
}

}  // namespace slicecorr::farm
