// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "watch/install.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "post/config.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/lasting_folder.hpp"
#include "support/files/temporary.hpp"
#include "support/files/text_file.hpp"
#include "support/process/command.hpp"

namespace slicecorr::post {

namespace fs = std::filesystem;

namespace {

constexpr const char* kBegin = "# slicecorr-post --install-watch ";
constexpr const char* kEnd = "# end of slicecorr-post --install-watch ";

/// In double quotes, as systemd's units and TOML alike have texts.
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + "\"";
}

std::string percent_doubled(const std::string& text) {
  std::string out;
  for (const char c : text) out += c == '%' ? "%%" : std::string(1, c);
  return out;
}

/// An argument of a unit's command line, in which % and $ stand for other things.
std::string unit_argument(const std::string& text) {
  std::string out;
  for (const char c : percent_doubled(quoted(text))) out += c == '$' ? "$$" : std::string(1, c);
  return out;
}

/// A pattern that a folder alone matches.
std::string folder_pattern(const std::string& folder) {
  std::string out;
  for (const char c : folder) {
    if (c == '*' || c == '?' || c == '[' || c == ']' || c == '\\') out += '\\';
    out += c;
  }
  return out;
}

std::string folder_of(const std::string& given) {
  std::error_code ec;
  const fs::path folder = fs::weakly_canonical(given, ec);
  std::string text = ec ? fs::absolute(given).lexically_normal().string() : folder.string();
  if (std::any_of(text.begin(), text.end(),
                  [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; })) {
    throw InputError(given, "", "has a control character in its name, which no unit can hold");
  }
  return text;
}

/// Where units of the user lie.
std::string unit_folder() {
  const char* const given = std::getenv("XDG_CONFIG_HOME");
  const char* const home = std::getenv("HOME");
  if (given != nullptr && *given == '/') return std::string(given) + "/systemd/user";
  if (home != nullptr && *home == '/') return std::string(home) + "/.config/systemd/user";
  throw InputError("expected HOME or XDG_CONFIG_HOME to be a path: units of systemd lie there");
}

std::string config_path(const std::string& given) {
  if (!given.empty()) return fs::absolute(given).string();
  const std::string folder = user_definition_folder();
  if (folder.empty()) throw InputError("expected HOME to be a path: the config file lies there");
  return folder + "/post.toml";
}

std::string rule_text(const std::string& folder, const Values& values) {
  std::string text = fmt::format("[[rule]]\nname = {}\nfolder = {}\n", quoted("watch of " + folder),
                                 quoted(folder_pattern(folder)));
  for (const auto& [name, value] : values) {
    std::string key = name;
    std::replace(key.begin(), key.end(), '-', '_');
    text += fmt::format("{} = {}\n", key, quoted(value));
  }
  return text;
}

/// Paths are meant from where the program was called, not from where the unit runs it.
Values with_whole_paths(Values values) {
  for (auto& [name, value] : values) {
    const fs::path path = value;
    std::error_code ec;
    const bool is_path = value.find('/') != std::string::npos || path.extension() == ".toml";
    if (is_path && fs::exists(path, ec)) value = fs::absolute(path).lexically_normal().string();
  }
  return values;
}

/// Of what a config file is that may be a link, as those of people who keep them elsewhere are.
void write_text(const std::string& given, const std::string& text) {
  std::error_code ec;
  const fs::path target = fs::is_symlink(given, ec) ? fs::canonical(given, ec) : fs::path(given);
  const std::string path = ec ? given : target.string();
  detail::make_lasting_folder(detail::path_parts(path).folder, ec);
  detail::check_new_file(path);
  detail::Temporary temporary{detail::make_temporary(path)};
  {
    std::ofstream out(temporary.path, std::ios::binary);
    out << text;
    out.close();
    if (!out) throw DeviceError(path + ": can't be written");
  }
  if (fs::exists(path, ec)) detail::copy_mode(path, temporary.path);
  detail::put_in_place(temporary, path);
}

/// Tells the manager; what went wrong first.
std::string tell_manager(const std::vector<std::vector<std::string>>& commands) {
  for (std::vector<std::string> command : commands) {
    command.insert(command.begin(), {"systemctl", "--user", "--no-ask-password"});
    Command run(command, std::chrono::seconds(60));
    run.wait(std::chrono::seconds(61));
    if (run.result().ok()) continue;
    return run.result().started ? run.result().complaint() : "there is no systemctl";
  }
  return {};
}

struct Places {
  std::string folder, config, unit_name, unit, link;
};
Places places_of(const WatchInstall& install) {
  Places p;
  p.folder = folder_of(install.folder);
  p.config = config_path(install.config);
  p.unit_name = watch_unit_name(p.folder);
  p.unit = unit_folder() + "/" + p.unit_name;
  p.link = unit_folder() + "/default.target.wants/" + p.unit_name;
  return p;
}

}  // namespace

std::string watch_unit_name(const std::string& folder) {
  std::string name;
  for (const fs::path& part : fs::path(folder).lexically_normal().relative_path()) {
    const std::string text = part.string();
    if (text.empty()) continue;
    if (!name.empty()) name += '-';
    for (const char c : text) {
      const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                         (c >= '0' && c <= '9') || c == ':' || c == '_' ||
                         (c == '.' && !name.empty());
      name += plain ? std::string(1, c) : fmt::format("\\x{:02x}", static_cast<unsigned char>(c));
    }
  }
  return fmt::format("slicecorr-watch-{}.service", name.empty() ? "-" : name);
}

std::string watch_unit_text(const std::string& folder, const std::string& program,
                            const std::vector<std::string>& options) {
  std::string command = unit_argument(program);
  for (const std::string& option : options) command += " " + unit_argument(option);
  command += " --watch " + unit_argument(folder);
  // The manager has another environment than a shell.
  const char* const database = std::getenv("SLICECORR_DB");
  const std::string environment =
      database != nullptr && *database != 0
          ? "Environment=" +
                percent_doubled(quoted("SLICECORR_DB=" + fs::absolute(database).string())) + "\n"
          : "";
  return fmt::format(
      "# Made by slicecorr-post --install-watch; slicecorr-post --uninstall-watch takes it away.\n"
      "[Unit]\nDescription=Corrects resin print slices that are exported to {}\n"
      "Documentation=man:slicecorr-post(1)\n\n"
      "[Service]\n# Printer, resin and the like are in a rule of the config file.\n"
      "{}ExecStart={}\n"
      "# Asked to stop it ends with 130. A wrong config file (2) is not tried again.\n"
      "SuccessExitStatus=130\nRestart=on-failure\nRestartPreventExitStatus=2\nNice=10\n\n"
      "[Install]\nWantedBy=default.target\n",
      percent_doubled(folder), environment, command);
}

std::string with_watch_rule(const std::string& text, const std::string& folder,
                            const std::string& rule) {
  const std::string begin = kBegin + folder + "\n", end = kEnd + folder + "\n";
  std::string before = text, after;
  std::size_t at = text.starts_with(begin) ? 0 : text.find("\n" + begin);
  if (at != text.npos) {
    at += text.starts_with(begin) ? 0 : 1;
    const std::size_t last = text.find("\n" + end, at);
    if (last == text.npos) {
      throw InputError(fmt::format(
          "the config file has the line '{}{}', but not that of its end; expected '{}{}'", kBegin,
          folder, kEnd, folder));
    }
    before = text.substr(0, at);
    after = text.substr(last + 1 + end.size());
  }
  if (rule.empty()) return before + after;
  if (!before.empty() && before.back() != '\n') before += '\n';
  return before + begin + rule + end + after;
}

WatchInstalled install_watch(const WatchInstall& install) {
  const Places p = places_of(install);
  std::error_code ec;
  if (!fs::is_directory(p.folder, ec)) {
    throw InputError(install.folder, "", "is not a folder that can be watched");
  }
  Values values = with_whole_paths(install.values);
  // The unit meets exports over corrected files: the old backup is of no use then.
  values.try_emplace("backup", "replace");
  const std::string old = text_of_file(p.config).value_or("");
  if (old.empty() && fs::exists(p.config, ec) && fs::file_size(p.config, ec) > 0) {
    throw InputError(p.config, "", "can't be read");
  }
  const std::string config = with_watch_rule(old, p.folder, rule_text(p.folder, values));
  const Config checked = parse_config(config, p.config);
  const Rule* const first = checked.match({p.folder + "/part.sl1", {}});
  const std::string program = fs::read_symlink("/proc/self/exe", ec).string();
  if (ec) throw DeviceError("/proc/self/exe: can't be read: " + ec.message());
  std::vector<std::string> options{"--notify", "--text-beside", "--config", p.config};
  options.insert(options.end(), install.options.begin(), install.options.end());
  write_text(p.unit, watch_unit_text(p.folder, program, options));
  write_text(p.config, config);
  detail::make_lasting_folder(detail::path_parts(p.link).folder, ec);
  fs::remove(p.link, ec);
  fs::create_symlink("../" + p.unit_name, p.link, ec);
  if (ec) throw DeviceError(p.link + ": can't be made: " + ec.message());
  detail::sync_folder(detail::path_parts(p.link).folder);
  WatchInstalled done;
  done.text =
      fmt::format("{}: is watched by the unit {}\n  rule: in {}\n", p.folder, p.unit, p.config);
  if (first != nullptr && first->name != "watch of " + p.folder) {
    done.text += fmt::format("  but {}, line {}, comes before it and matches files there, too\n",
                             first->name, first->line);
  }
  done.problem = tell_manager({{"daemon-reload"}, {"restart", p.unit_name}});
  return done;
}

WatchInstalled uninstall_watch(const WatchInstall& install) {
  const Places p = places_of(install);
  const std::string old = text_of_file(p.config).value_or("");
  const std::string config = with_watch_rule(old, p.folder, "");
  std::error_code ec;
  if (config == old && !fs::exists(p.unit, ec)) {
    throw InputError(install.folder, "",
                     fmt::format("no watch was set up for it: there is no {}, and no rule in {}",
                                 p.unit, p.config));
  }
  WatchInstalled done;
  done.problem = tell_manager({{"stop", p.unit_name}});
  fs::remove(p.link, ec);
  if (fs::exists(p.unit) && !fs::remove(p.unit, ec)) {
    throw DeviceError(p.unit + ": can't be removed: " + ec.message());
  }
  if (config != old) write_text(p.config, config);
  if (done.problem.empty()) done.problem = tell_manager({{"daemon-reload"}});
  done.text = fmt::format("{}: is watched no more; unit and rule are gone\n", p.folder);
  return done;
}

}  // namespace slicecorr::post
