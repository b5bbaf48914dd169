// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "watch/done.hpp"

#include <fmt/format.h>

#include <cstring>
#include <iterator>
#include <new>
#include <nlohmann/json.hpp>

#include "programs/common/program.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/verdict.hpp"
#include "support/json/members.hpp"
#include "support/json/read_json.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::post {

namespace {

using Kind = Done::Kind;
using Json = nlohmann::ordered_json;

constexpr std::pair<Kind, const char*> kKinds[] = {
    {Kind::corrected, "corrected"},   {Kind::already, "already"},
    {Kind::left_alone, "left alone"}, {Kind::not_readable, "not readable"},
    {Kind::in_use, "in use"},         {Kind::failed, "failed"},
    {Kind::cancelled, "cancelled"},   {Kind::killed, "killed"}};

/// What a correction came to: nobody sees the print before it is printed, so the verdict is first.
std::string lines_of(const PostOutcome& outcome, const std::vector<std::string>& remarks) {
  const Correction& c = outcome.correction;
  const auto mean = [](const Prediction& p) {
    return p.height_error_um.count() ? fmt::format("{:.3g}", p.height_error_um.mean()) : "-";
  };
  std::string text = verdict_of(c.after).words;
  const auto line = [&](const std::string& words) {
    if (!words.empty()) text += "\n" + words;
  };
  if (c.before) line(worse_than_none(c.after, *c.before));
  line(holds_without_lifts(outcome.format, outcome.setup.process));
  line(fmt::format("{} slices, {}", c.info.grid.layers,
                   in_one_line(outcome.setup.printer, outcome.setup.resin, *c.info.process)));
  line(fmt::format("mean height error {} um, before {} um", mean(c.after),
                   c.before ? mean(*c.before) : "-"));
  line(outcome.rule);
  for (const std::string& remark : remarks) line(remark);
  for (const std::string& path : outcome.removed) {
    // A text is written anew where it is asked for.
    if (!path.ends_with(".txt")) line("taken away: " + path);
  }
  return text;
}

}  // namespace

Done correct_and_tell(const std::string& path, const PostRequest& request,
                      const ExecutionContext& given) {
  Done done{path, Kind::failed, cli::kDefect, {}, 0, {}, {}};
  const auto became = [&](Kind kind, int code, const std::string& message) {
    done.kind = kind;
    done.code = code;
    done.message = message;
  };
  try {
    ExecutionContext context = given;
    context.progress = nullptr;
    std::vector<std::string> remarks;
    context.notice = [&](const std::string& text) { remarks.push_back(text); };
    const PostOutcome outcome = correct_file(path, request, context);
    if (outcome.left_alone) {
      became(Kind::left_alone, cli::kDone, outcome.rule);
    } else {
      done.made = outcome.identity;
      done.verdict = name_of(verdict_of(outcome.correction.after).outcome);
      became(Kind::corrected, cli::kDone, lines_of(outcome, remarks));
    }
  } catch (const AlreadyCorrected&) {
    became(Kind::already, cli::kDone, {});
  } catch (const InUse& e) {
    became(Kind::in_use, cli::kInput, e.what());
  } catch (const NotReadable& e) {
    became(Kind::not_readable, cli::kInput, e.what());
  } catch (...) {
    const Failure failure = failure_at_hand();
    const bool cancelled = failure.kind == Failure::Kind::cancelled;
    became(cancelled ? Kind::cancelled : Kind::failed, cli::exit_code(failure.kind),
           cancelled ? std::string() : failure.text);
  }
  return done;
}

std::string done_json(const Done& done) {
  Json json;
  for (const auto& [kind, name] : kKinds) {
    if (kind == done.kind) json["kind"] = name;
  }
  json["code"] = done.code;
  json["message"] = done.message;
  if (!done.verdict.empty()) json["verdict"] = done.verdict;
  const FileIdentity& made = done.made;
  json["made"] = {made.device, made.inode, made.bytes, made.modified_ns};
  return json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

Done done_in(const CommandResult& result, const std::string& path) {
  Done done{path, Kind::failed, cli::kDefect, {}, 0, {}, {}};
  if (!result.started) {
    done.code = cli::kDevice;
    done.message = result.err;
    return done;
  }
  if (result.signal != 0) {
    done.kind = Kind::killed;
    done.message = fmt::format("signal {} ({}) ended the program that read it", result.signal,
                               ::strsignal(result.signal));
    return done;
  }
  const auto json = slicecorr::detail::try_json<Json>(result.out);
  const std::string kind = slicecorr::detail::text_in(json, "kind");
  const auto& made = slicecorr::detail::member_of(json, "made");
  const auto known = std::find_if(std::begin(kKinds), std::end(kKinds),
                                  [&](const auto& k) { return kind == k.second; });
  const bool whole =
      made.is_array() && made.size() == 4 &&
      std::all_of(made.begin(), made.end(), [](const Json& n) { return n.is_number_integer(); });
  if (known == std::end(kKinds) || !whole) {
    // It ended before it could say anything: wrong settings, or no room.
    done.code = result.exit_code;
    done.message = text::printable(result.complaint());
    return done;
  }
  done.kind = known->first;
  done.code = slicecorr::detail::whole_in(json, "code", cli::kDefect);
  done.message = slicecorr::detail::text_in(json, "message");
  done.verdict = slicecorr::detail::text_in(json, "verdict");
  done.made = {made[0].get<dev_t>(), made[1].get<ino_t>(), made[2].get<off_t>(),
               made[3].get<std::int64_t>()};
  return done;
}

}  // namespace slicecorr::post
