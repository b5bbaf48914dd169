// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `slicefarm serve` and `notify`.

#include <fmt/format.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <atomic>
#include <memory>
#include <thread>

#include "commands.hpp"
#include "programs/common/mesh_options.hpp"
#include "programs/common/run_server.hpp"
#include "serve/plate.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/as_sdcp.hpp"
#include "slicecorr/farm/notify.hpp"
#include "slicecorr/farm/serve.hpp"
#include "support/http/guard.hpp"

namespace slicecorr::farm {

namespace {

struct ServeCommand {
  FarmOptions farm;
  std::string listen = "127.0.0.1:8420", token_file, accounts_file, user;
  std::vector<std::string> host_names, allowed_folders;
  std::string as_printer, printer_listen = "127.0.0.1:8430", printer_key_file;
  std::vector<std::string> printer_clients;
  int printer_udp_port = 3000;
  double most_upload_mb = 512;
  int studies = 1;
  bool notify = true;
};

/// The farm as a printer, beside its own pages.
struct Printer {
  std::unique_ptr<PrinterServer> http;
  std::unique_ptr<SdcpPrinter> sdcp;
  std::string address;
  explicit operator bool() const { return http || sdcp; }
  void run() const { http ? http->run() : sdcp->run(); }
  void stop() const { http ? http->stop() : sdcp->stop(); }
};

Printer as_printer(const ServeCommand& o, const FarmFolder& folder, const ServeOptions& like) {
  Printer printer;
  if (o.as_printer.empty()) return printer;
  AsPrinterOptions options;
  std::tie(options.host, options.port) = http::host_and_port(o.printer_listen);
  options.machine = o.as_printer;
  options.host_names = like.host_names;
  options.most_upload_bytes = like.most_upload_bytes;
  options.submit =
      make_submitter({folder, o.allowed_folders, o.user.empty() ? user_name() : o.user});
  const bool sdcp = machine_named(folder, o.as_printer).kind == MachineKind::sdcp3;
  if (sdcp) {
    if (o.printer_clients.empty() || !o.printer_key_file.empty()) {
      throw InputError(
          "SDCP knows no key: --as-printer of such a machine wants --printer-client, the address of "
          "each computer that may send");
    }
    printer.sdcp = std::make_unique<SdcpPrinter>(
        folder, AsSdcpOptions{options, o.printer_udp_port, o.printer_clients});
    printer.address = fmt::format("{}:{}, calls at port {}", options.host, printer.sdcp->port(),
                                  printer.sdcp->udp_port());
    return printer;
  }
  if (o.printer_key_file.empty() || !o.printer_clients.empty()) {
    throw InputError("--as-printer wants --printer-key-file, the key that slicers send");
  }
  options.key = http::read_token_file(o.printer_key_file, 8);
  printer.http = std::make_unique<PrinterServer>(folder, options);
  printer.address = printer.http->address();
  return printer;
}

int serve(const ServeCommand& o, cli::Console& console) {
  const FarmFolder folder = o.farm.open();
  ServeOptions options;
  std::tie(options.host, options.port) = http::host_and_port(o.listen);
  if (!o.token_file.empty()) options.token = http::read_token_file(o.token_file);
  if (!o.accounts_file.empty()) options.accounts = read_accounts_file(o.accounts_file);
  options.children.studies = o.studies;
  for (const std::string& name : o.host_names) options.host_names += name + ",";
  options.most_upload_bytes = static_cast<std::int64_t>(o.most_upload_mb * 1e6);
  const bool reading = options.token.empty() && options.accounts.empty();
  if (!reading) {
    options.submit =
        make_submitter({folder, o.allowed_folders, o.user.empty() ? user_name() : o.user});
  }
  FarmServer server(folder, options);
  const Printer printer = as_printer(o, folder, options);
  http::take_sigterm();
  std::optional<Notifier> notifier;
  if (o.notify) notifier.emplace(folder);
  cli::print_result(server.address() + "\n");
  if (printer) console.say("as the printer " + o.as_printer + ": " + printer.address);
  console.say(reading ? "serving; nothing can be changed without --token-file or --accounts"
                      : "serving");
  return http::serve_until_ended(
      [&] {
        std::atomic<bool> ended{!printer};
        std::thread beside;
        if (printer) {
          beside = std::thread([&] {
            printer.run();
            ended = true;
          });
        }
        server.run();
        // Who is told to stop before it has begun does not hear it.
        while (!ended) {
          printer.stop();
          ::poll(nullptr, 0, 20);
        }
        if (beside.joinable()) beside.join();
      },
      [&] {
        server.stop();
        if (printer) printer.stop();
      },
      [&] { notifier.reset(); });
}

struct PlateCommand {
  detail::PlateJob job;
  cli::MeshOptions mesh;
};

/// What a study runs: writes the files for a browser into the present folder.
int plate(const PlateCommand& o, const ExecutionContext& context) {
  detail::PlateJob job = o.job;
  job.meshes = o.mesh;
  job.layer_um = o.mesh.layer_um;
  job.folder = ".";
  detail::write_plate(job, context);
  return cli::kDone;
}

struct NotifyCommand {
  FarmOptions farm;
  bool test = false;
};

int notify(const NotifyCommand& o, cli::Console& console) {
  const FarmFolder folder = o.farm.existing();
  if (o.test) {
    const std::vector<NotifyTarget> targets = read_notify_file(folder.root + "/notify.toml");
    if (targets.empty()) {
      throw InputError(folder.root + "/notify.toml", "",
                       "names nobody to tell; expected [[webhook]] or [[command]]");
    }
    Notice notice;
    notice.id = "test";
    notice.kind = "test";
    notice.json = R"({"id":"test","kind":"test","text":"a test of the farm's notifications"})";
    notice.variables = {{"FARM_ID", "test"},
                        {"FARM_KIND", "test"},
                        {"FARM_TEXT", "a test of the farm's notifications"}};
    const int never = ::eventfd(0, EFD_CLOEXEC);
    bool good = true;
    for (const NotifyTarget& t : targets) {
      const std::string trouble = deliver(t, notice, never);
      console.say(t.name + ": " + (trouble.empty() ? "taken" : trouble));
      good = good && trouble.empty();
    }
    ::close(never);
    if (!good) throw DeviceError("not all receivers took the message");
    return cli::kDone;
  }
  const Notifier notifier(folder);
  http::take_sigterm();
  while (!http::ended()) ::poll(nullptr, 0, 100);
  return http::exit_code_of_end();
}

}  // namespace

void add_serve_commands(cli::Program& program) {
  {
    auto o = std::make_shared<ServeCommand>();
    CLI::App* app = program.add(
        "serve", "Serve a page, a REST API and metrics; prints its address",
        [o](const ExecutionContext&, cli::Console& console) { return serve(*o, console); });
    o->farm.add_to(*app);
    app->add_option("--listen", o->listen, "HOST:PORT; port 0: one that is free [127.0.0.1:8420]")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--token-file", o->token_file,
                    "File (mode 0600) with the token that changes need, and all requests beyond "
                    "this machine");
    app->add_option("--accounts", o->accounts_file,
                    "File (mode 0600) with a line ROLE NAME TOKEN for everybody who may use the "
                    "farm; roles: look, submit, operate");
    app->add_option("--studies", o->studies,
                    "Plates, plans, checks and fits that are computed at a time [1]")
        ->check(CLI::Range(1, 64));
    app->add_option("--host-name", o->host_names,
                    "Further name under which browsers reach this server, as NAME")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option(
        "--allow-dir", o->allowed_folders,
        "Folder in which submitted jobs may name parts and outputs [none: uploads only]");
    app->add_option("--max-upload-mb", o->most_upload_mb, "Largest part that may be uploaded [512]")
        ->check(cli::number_in(0.001, 1e6));
    app->add_option("--as-printer", o->as_printer,
                    "Answer as the machine NAME of machines.toml, too: what slicers send to it is "
                    "corrected by its rule")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--printer-listen", o->printer_listen,
                    "HOST:PORT of the printer that the farm is [127.0.0.1:8430]")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--printer-client", o->printer_clients,
                    "As a printer that speaks SDCP, which knows no key: IPv4 address of a computer "
                    "that may send; may be repeated")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--printer-udp-port", o->printer_udp_port,
                    "As such a printer: UDP port at which slicers call [3000]")
        ->check(CLI::Range(0, 65535));
    app->add_option("--printer-key-file", o->printer_key_file,
                    "File (mode 0600) with the key of at least 8 characters that slicers send")
        ->check(cli::value_is(cli::ValueKind::file));
    app->add_option("--user", o->user, "User of submitted jobs that name none [who serves]")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_flag("!--no-notify", o->notify, "Send no notifications (DIR/notify.toml)");
  }
  {
    auto o = std::make_shared<PlateCommand>();
    CLI::App* app = program.add(
        "plate", "Parts for a browser to show: what studies start",
        [o](const ExecutionContext& context, cli::Console&) { return plate(*o, context); });
    app->add_option("PART", o->mesh.parts, "Meshes that were sliced");
    app->add_option("--stack", o->job.stack, "Their slices, or an archive")->required();
    app->add_option("--printer", o->job.printer, "Printer")->required();
    app->add_option("--layer-um", o->mesh.layer_um, "Where the archive says none")
        ->check(cli::number_in(1, 1000));
    o->mesh.add_placement_to(*app);
    o->mesh.add_plate_to(*app);
    app->group("");  // not for people
  }
  {
    auto o = std::make_shared<NotifyCommand>();
    CLI::App* app = program.add(
        "notify", "Send the notifications of DIR/notify.toml until stopped",
        [o](const ExecutionContext&, cli::Console& console) { return notify(*o, console); });
    o->farm.add_to(*app);
    app->add_flag("--test", o->test, "Send one message to every receiver now, and end");
  }
}

}  // namespace slicecorr::farm
