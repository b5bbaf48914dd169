// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "machines/http_calls.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <httplib.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>

#include "slicecorr/error.hpp"
#include "slicecorr/farm/token.hpp"
#include "slicecorr/version.hpp"
#include "support/files/errno_message.hpp"
#include "support/http/guard.hpp"
#include "support/http/why_no_answer.hpp"
#include "support/json/members.hpp"
#include "support/json/read_json.hpp"
#include "support/process/no_sigpipe.hpp"
#include "support/text/ascii.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm::detail {

using slicecorr::detail::errno_message;

namespace {

std::chrono::milliseconds ms(double seconds) {
  return std::chrono::milliseconds(static_cast<long>(seconds * 1000));
}

/// A part of a file that is read while it is sent.
class FilePart {
 public:
  explicit FilePart(const HttpBody& body) : body_(body) {
    if (body.path.empty()) return;
    file_ = ::open(body.path.c_str(), O_RDONLY | O_CLOEXEC);
    if (file_ < 0) throw InputError(errno_message(body.path, "can't be read"));
  }
  ~FilePart() {
    if (file_ >= 0) ::close(file_);
  }
  FilePart(const FilePart&) = delete;
  FilePart& operator=(const FilePart&) = delete;
  std::size_t size() const {
    return body_.before.size() + static_cast<std::size_t>(body_.bytes) + body_.after.size();
  }
  /// What is at a place of the body, at most 64 KiB; empty where the file is shorter than it was.
  std::string at(std::size_t place) const {
    const std::size_t file_bytes = static_cast<std::size_t>(body_.bytes);
    if (place < body_.before.size()) return body_.before.substr(place);
    place -= body_.before.size();
    if (place >= file_bytes) return body_.after.substr(place - file_bytes);
    std::string bytes(std::min(file_bytes - place, std::size_t{64} << 10), '\0');
    const ssize_t n = ::pread(file_, bytes.data(), bytes.size(),
                              static_cast<off_t>(body_.from + static_cast<std::int64_t>(place)));
    bytes.resize(n > 0 ? static_cast<std::size_t>(n) : 0);
    return bytes;
  }

 private:
  const HttpBody& body_;
  int file_ = -1;
};

std::string escaped_name(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '"')
      out += "%22";
    else if (c != '\r' && c != '\n')
      out += c;
  }
  return out;
}

}  // namespace

std::string host_text(const std::string& host, int port) {
  return host.find(':') != host.npos ? fmt::format("[{}]:{}", host, port)
                                     : fmt::format("{}:{}", host, port);
}

std::string path_segment(const std::string& text) {
  std::string out;
  for (const char c : text) {
    const char small = lower_case(c);
    const bool plain = (small >= 'a' && small <= 'z') || is_digit(c) || c == '-' || c == '.' ||
                       c == '_' || c == '~';
    out += plain ? std::string(1, c) : fmt::format("%{:02X}", static_cast<unsigned char>(c));
  }
  return out;
}

HttpBody form_body(const std::vector<FormField>& fields, const MachineFile* file, std::int64_t from,
                   std::int64_t bytes) {
  const std::string boundary = "----slicecorr" + random_token();
  HttpBody body;
  for (const FormField& f : fields) {
    body.before += fmt::format("--{}\r\nContent-Disposition: form-data; name=\"{}\"", boundary,
                               escaped_name(f.name));
    if (f.file_name.empty()) {
      body.before += "\r\n\r\n" + f.value + "\r\n";
    } else {
      body.before +=
          fmt::format("; filename=\"{}\"\r\nContent-Type: application/octet-stream\r\n\r\n{}",
                      escaped_name(f.file_name), f.value);
    }
  }
  if (file) {
    body.path = file->path;
    body.from = from;
    body.bytes = bytes;
  }
  body.after = fmt::format("{}--{}--\r\n", file ? "\r\n" : "", boundary);
  body.type = "multipart/form-data; boundary=" + boundary;
  return body;
}

HttpLogin HttpLogin::of(const MachineSpec& machine, Kind otherwise) {
  HttpLogin login;
  login.kind = machine.login == "digest" ? Kind::digest
               : machine.login == "key"  ? Kind::key
               : machine.login == "none" ? Kind::none
                                         : otherwise;
  if (login.kind == Kind::none) return login;
  login.user = machine.user.empty() ? "maker" : machine.user;
  if (machine.key_file.empty()) {
    throw InputError("the machine " + machine.name +
                     " wants a key: expected key_file in machines.toml, or login = \"none\"");
  }
  login.secret = http::read_token_file(machine.key_file, 1);
  return login;
}

HttpCalls::HttpCalls(std::string host, int port, const MachineTimes& times, HttpLogin login)
    : host_(std::move(host)), port_(port), times_(times), login_(std::move(login)) {}

std::string HttpCalls::where() const { return host_text(host_, port_); }

std::string HttpCalls::authorization(const char* method, const std::string& path) {
  if (login_.kind != HttpLogin::Kind::digest || !challenge_) return {};
  return digest_header(*challenge_, {login_.user, login_.secret},
                       {method, path, ++count_, random_token().substr(0, 16)});
}

HttpAnswer HttpCalls::call_once(const char* method, const std::string& path, HttpHeaders headers,
                                const HttpBody* body) {
  if (times_.cancel && *times_.cancel) throw Cancelled();
  httplib::Client client(host_, port_);
  client.set_connection_timeout(ms(times_.answer_s));
  client.set_read_timeout(ms(std::max(times_.answer_s, body ? answer_s_ : 0.0)));
  client.set_write_timeout(ms(times_.stall_s));
  client.set_follow_location(false);
  httplib::Request request;
  request.method = method;
  request.path = path;
  request.headers = {{"User-Agent", fmt::format("slicefarm/{}", version)}};
  if (login_.kind == HttpLogin::Kind::key) headers.emplace_back("X-Api-Key", login_.secret);
  if (const std::string proof = authorization(method, path); !proof.empty()) {
    headers.emplace_back("Authorization", proof);
  }
  if (!cookie_.empty()) headers.emplace_back("Cookie", cookie_);
  for (const auto& [name, value] : headers) request.headers.emplace(name, value);
  std::optional<FilePart> part;
  bool shortened = false, stopped = false;
  if (body) {
    part.emplace(*body);
    request.headers.emplace("Content-Type", body->type);
    request.content_length_ = part->size();
    request.content_provider_ = [&](std::size_t at, std::size_t, httplib::DataSink& sink) {
      stopped = times_.cancel && *times_.cancel;
      const std::string bytes = stopped ? std::string() : part->at(at);
      shortened = bytes.empty() && !stopped;
      if (bytes.empty() || !sink.write(bytes.data(), bytes.size())) return false;
      if (body->progress) {
        const auto sent = static_cast<std::int64_t>(at + bytes.size()) -
                          static_cast<std::int64_t>(body->before.size());
        body->progress(std::clamp<std::int64_t>(sent, 0, body->bytes), body->bytes);
      }
      return true;
    };
  } else if (std::string_view(method) != "GET") {
    request.headers.emplace("Content-Length", "0");
  }
  HttpAnswer answer;
  bool too_long = false;
  request.content_receiver = [&](const char* data, std::size_t size, std::uint64_t, std::uint64_t) {
    too_long = answer.body.size() + size > kMostAnswerBytes;
    if (!too_long) answer.body.append(data, size);
    return !too_long;
  };
  const NoSigpipe no_sigpipe;
  const httplib::Result result = client.send(request);
  if (stopped) throw Cancelled();
  if (shortened) throw InputError(body->path, "", "became shorter while it was sent");
  if (too_long) throw DeviceError(where() + ": its answer is longer than 8 MiB");
  if (!result) {
    throw DeviceError(
        fmt::format("{}: no answer ({})", where(), http::why_no_answer(result.error())));
  }
  answer.status = result->status;
  if (answer.body.empty()) answer.body = result->body;
  answer.type = result->get_header_value("Content-Type");
  answer.location = result->get_header_value("Location");
  answer.challenge = result->get_header_value("WWW-Authenticate");
  const std::string cookie = result->get_header_value("Set-Cookie");
  answer.cookie = cookie.substr(0, cookie.find(';'));
  return answer;
}

HttpAnswer HttpCalls::call(const char* method, const std::string& path, const HttpHeaders& headers,
                           const HttpBody* body) {
  if (refused_) throw InputError(where() + ": does not take the key or password; not tried again");
  HttpAnswer answer = call_once(method, path, headers, body);
  if (answer.status != 401 || login_.kind != HttpLogin::Kind::digest) return answer;
  // Once: a wrong password must not be tried until the machine locks us out.
  const bool first = !challenge_;
  const std::optional<DigestChallenge> challenge = read_challenge(answer.challenge);
  if (!challenge || (!first && !challenge->stale && challenge->nonce == challenge_->nonce)) {
    return answer;
  }
  challenge_ = challenge;
  count_ = 0;
  answer = call_once(method, path, headers, body);
  refused_ = answer.status == 401;
  return answer;
}

HttpAnswer HttpCalls::send_text(const char* method, const std::string& path,
                                const std::string& text, const std::string& type) {
  HttpBody body;
  body.before = text;
  body.type = type;
  return call(method, path, {}, &body);
}

HttpAnswer HttpCalls::send_body(const char* method, const std::string& path, const HttpBody& body,
                                const std::string& prime, const HttpHeaders& headers) {
  // A fresh nonce, so that the long body is not sent in vain: the one that is known may have been used
  // as often as it may.
  if (login_.kind == HttpLogin::Kind::digest && !prime.empty()) {
    challenge_.reset();
    HttpAnswer answer = get(prime);
    if (answer.status == 401) return answer;
  }
  return call_once(method, path, headers, &body);
}

std::string http_trouble(const HttpAnswer& answer) {
  using Json = nlohmann::ordered_json;
  const Json json = slicecorr::detail::try_json<Json>(answer.body, {kMostAnswerBytes, 16, 100'000});
  std::string said;
  for (const char* key : {"title", "message", "error"}) {
    const std::string text = slicecorr::detail::text_in(json, key);
    if (!text.empty()) said += (said.empty() ? "" : ": ") + text;
  }
  const char* why = answer.status == 401   ? " (the key or password is not taken)"
                    : answer.status == 403 ? " (not allowed)"
                    : answer.status == 404 ? " (not there)"
                    : answer.status == 409 ? " (it is busy, or the name is taken)"
                    : answer.status == 413 ? " (the file is too large for it)"
                    : answer.status == 415 ? " (it does not read such files)"
                                           : "";
  return fmt::format("answers {}{}{}", answer.status, why,
                     said.empty() ? "" : ": " + text::clipped(text::printable(said), 200));
}

}  // namespace slicecorr::farm::detail
