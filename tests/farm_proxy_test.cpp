// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The farm's pages behind a reverse proxy that shows them under a path: nginx takes /lab/resin/ off what it passes
// on, so that the farm never knows of it, and everything must be found by addresses that are relative.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>

#include <filesystem>
#include <fstream>
#include <regex>

#include "devtools.hpp"
#include "farm_served.hpp"
#include "ladder.hpp"

extern char** environ;

namespace slicecorr::farm {
namespace {

namespace fs = std::filesystem;
using namespace slicecorr::test;
using namespace test;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

const std::string kOperator(40, 'p');

std::string nginx_program() {
  for (const char* path : {"/usr/sbin/nginx", "/usr/bin/nginx", "/usr/local/sbin/nginx"}) {
    if (fs::exists(path)) return path;
  }
  return {};
}

/// A port that nobody has now.
int free_port() {
  const int socket = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  EXPECT_EQ(::bind(socket, reinterpret_cast<sockaddr*>(&address), size), 0);
  EXPECT_EQ(::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size), 0);
  ::close(socket);
  return ntohs(address.sin_port);
}

/// nginx with the lines of docs/farm-api.md, before a farm's server on this machine.
class Nginx {
 public:
  Nginx(const std::string& folder, int upstream) : port(free_port()) {
    fs::create_directories(folder);
    const std::string config = folder + "/nginx.conf";
    std::string temporary;
    for (const char* kind : {"client_body", "proxy", "fastcgi", "uwsgi", "scgi"}) {
      temporary += fmt::format("  {0}_temp_path {1}/{0};\n", kind, folder);
    }
    std::ofstream(config) << fmt::format(
        "daemon off;\nmaster_process off;\npid {0}/pid;\nerror_log {0}/error.log;\n"
        "events {{ worker_connections 64; }}\nhttp {{\n  access_log off;\n{1}"
        "  server {{\n    listen 127.0.0.1:{2};\n"
        "    location /lab/resin/ {{\n{3}    }}\n"
        "    location /forgets/ {{ proxy_pass http://127.0.0.1:{4}/; }}\n"
        "    location / {{ return 404; }}\n  }}\n}}\n",
        folder, temporary, port, lines_of_docs(upstream), upstream);
    const std::string program = nginx_program();
    const std::string log = "-e" + folder + "/start.log";
    char* const argv[] = {const_cast<char*>(program.c_str()), const_cast<char*>(log.c_str()),
                          const_cast<char*>("-c"), const_cast<char*>(config.c_str()), nullptr};
    EXPECT_EQ(::posix_spawn(&pid_, argv[0], nullptr, nullptr, argv, environ), 0);
    for (int i = 0; i < 200; ++i) {
      httplib::Client client("127.0.0.1", port);
      if (client.Get("/")) return;
      ::usleep(50'000);
    }
    std::ifstream said(folder + "/error.log");
    ADD_FAILURE() << "nginx does not answer: "
                  << std::string{std::istreambuf_iterator<char>(said), {}};
  }
  ~Nginx() {
    ::kill(pid_, SIGTERM);
    ::waitpid(pid_, nullptr, 0);
  }
  Nginx(const Nginx&) = delete;
  Nginx& operator=(const Nginx&) = delete;
  const int port;

 private:
  /// What the documentation tells people to write, for the port of this farm.
  static std::string lines_of_docs(int upstream) {
    std::ifstream in(SLICECORR_SOURCE_DIR "/docs/farm-api.md");
    const std::string page{std::istreambuf_iterator<char>(in), {}};
    std::smatch found;
    if (!std::regex_search(page, found, std::regex(R"(location /lab/resin/ \{\n([^}]*)\})"))) {
      ADD_FAILURE() << "docs/farm-api.md has no location for nginx";
      return {};
    }
    return std::regex_replace(found[1].str(), std::regex("127\\.0\\.0\\.1:[0-9]+"),
                              fmt::format("127.0.0.1:{}", upstream));
  }
  pid_t pid_ = 0;
};

class FarmProxy : public ::testing::Test {
 protected:
  void SetUp() override {
    if (nginx_program().empty()) GTEST_SKIP() << "nginx is not installed (scripts/setup --all)";
    if (chromium().empty()) GTEST_SKIP() << "chromium is not installed (scripts/setup --all)";
    fs::create_directories(farm_.root + "/db");
    ::setenv("SLICECORR_DB", (farm_.root + "/db").c_str(), 1);
    options_.accounts = {{"pia", Role::operate, kOperator}};
    options_.submit = make_submitter({farm_.folder, {}, "web"});
    options_.host_names = "127.0.0.1";
    options_.children.programs = SLICECORR_BIN_DIR;
  }
  void TearDown() override { ::unsetenv("SLICECORR_DB"); }
  void serve() {
    served_ = std::make_unique<Served>(farm_, options_);
    nginx_ = std::make_unique<Nginx>(farm_.root + "/nginx", served_->port);
    base_ = fmt::format("http://127.0.0.1:{}/lab/resin/", nginx_->port);
  }
  void browse() {
    page_ = std::make_unique<DrivenPage>();
    page_->look_like(1300, 900, false);
  }
  void ready() { page_->wait_for("document.body.dataset.ready === 'yes'"); }
  std::string where() const { return page_->eval("location.href").get<std::string>(); }

  Farm farm_;
  ServeOptions options_;
  std::unique_ptr<Served> served_;
  std::unique_ptr<Nginx> nginx_;
  std::unique_ptr<DrivenPage> page_;
  std::string base_;
};

TEST_F(FarmProxy, PagesLinksUploadsAndDownloadsWorkUnderAPath) {
  const auto filled = fill(farm_);
  serve();
  browse();
  // Without the slash at the end nginx sends the browser to the folder.
  page_->open(base_.substr(0, base_.size() - 1));
  ready();
  EXPECT_EQ(where(), base_);
  page_->click("#who button");
  page_->set("token", kOperator);
  page_->click("#ask button");
  page_->wait_for("document.body.dataset.ready === 'yes' && me.role === 'operate'");
  // What the page asks for again and again comes: jobs, events, the timeline.
  page_->wait_for("document.querySelectorAll('#rows tr').length > 0");

  // A download is the file, byte by byte, by a link of the page and with its ticket.
  const auto job = farm_.model().job(filled.done[0]);
  page_->eval("showJob(" + std::to_string(filled.done[0]) + ", true)");
  page_->wait_for("document.getElementById('job-actions').textContent.includes('Download uvj')");
  const std::string href = page_
                               ->eval(
                                   "[...document.querySelectorAll('#job-actions a')].find((a) => "
                                   "a.textContent.startsWith('Download uvj')).href")
                               .get<std::string>();
  EXPECT_EQ(href, base_ + fmt::format("api/v1/jobs/{}/files/uvj", filled.done[0]));
  page_->eval(
      "window.got = null; change('api/v1/tickets', {path: '/api/v1/jobs/" +
      std::to_string(filled.done[0]) +
      "/files/uvj'}).then((t) => fetch(here(t.path))).then((a) => a.arrayBuffer()).then((b) => { "
      "window.got = b.byteLength; })");
  page_->wait_for("window.got !== null");
  EXPECT_EQ(page_->eval("window.got"), fs::file_size(job->output("uvj")));

  // The report of the last day, and its links to reports of parts.
  page_->eval(
      "window.at = null; change('api/v1/tickets', {path: '/report'}).then((t) => { window.at = "
      "here(t.path); })");
  page_->wait_for("window.at !== null");
  const std::string report = page_->eval("window.at").get<std::string>();
  EXPECT_THAT(report, StartsWith(base_ + "report?"));
  page_->open(report);
  const auto links = page_->eval("[...document.querySelectorAll('a')].map((a) => a.href)");
  ASSERT_GT(links.size(), 0U);
  for (const auto& link : links) EXPECT_THAT(link.get<std::string>(), StartsWith(base_));

  // From page to page by the links that people click.
  page_->open(base_);
  ready();
  for (const auto& [words, path] : {std::pair{"Print", "print"},
                                    {"Resins and printers", "materials"},
                                    {"Farm", ""},
                                    {"Print", "print"}}) {
    page_->eval(fmt::format(
        "[...document.querySelectorAll('nav a')].find((a) => a.textContent === '{}').click()",
        words));
    page_->wait_for(fmt::format("location.href === '{}{}'", base_, path));
    ready();
    // Style and scripts came, too.
    EXPECT_EQ(page_->eval("document.styleSheets[0].cssRules.length > 10"), true) << path;
  }

  // An upload, a study that looks at it, and a job.
  const std::string ladder = farm_.root + "/ladder.stl";
  slicecorr::test::write_stl(ladder, slicecorr::test::ladder());
  page_->choose_files("#files", {ladder});
  page_->wait_for("parts.there.length === 1");
  page_->set("printer", "dual-wavelength-dlp");
  page_->set("resin", "benchy-resin");
  page_->click("#look");
  page_->wait_for("!document.getElementById('plate').hidden");
  page_->wait_for("document.getElementById('layer-canvas').dataset.layer");
  page_->set("speed", "800");
  page_->click("#queue");
  page_->wait_for("document.getElementById('queue-said').textContent.includes('queued')");
  EXPECT_EQ(page_->eval("document.querySelector('#queued a').href"), base_);
  EXPECT_THAT(page_->complaints(), IsEmpty());

  // A resin's picture, and a printer by the form with its F.
  page_->open(base_ + "materials");
  ready();
  page_->set("find", "benchy");
  page_->click("#resins button.link");
  page_->wait_for("document.getElementById('curve-picture').naturalWidth > 100");
  for (const auto& [name, value] : {std::pair{"name", "lab-printer"},
                                    {"width_px", "1920"},
                                    {"height_px", "1080"},
                                    {"pixel_um", "50"},
                                    {"readings", "0 0.1\n64 4\n255 30"}}) {
    page_->eval(fmt::format("document.querySelector('#new-printer [name={}]').value = {}", name,
                            nlohmann::json(value).dump()));
  }
  EXPECT_EQ(page_->eval("document.querySelectorAll('#letters svg').length"), 8);
  // The picture of an F to show is as large as the display, black but for the F.
  page_->eval(
      "(() => { window.f = null; const make = URL.createObjectURL; URL.createObjectURL = (b) => { "
      "createImageBitmap(b).then((i) => { const c = new OffscreenCanvas(i.width, i.height), p = "
      "c.getContext('2d'); p.drawImage(i, 0, 0); const d = p.getImageData(0, 0, i.width, "
      "i.height).data; let lit = 0; for (let k = 0; k < d.length; k += 4) lit += d[k] === 255; "
      "window.f = [i.width, i.height, lit]; }); return make(b); }; "
      "document.getElementById('letter-file').click(); })()");
  page_->wait_for("window.f !== null");
  EXPECT_EQ(page_->eval("window.f"), nlohmann::json({1920, 1080, 14 * 120 * 120}));
  page_->eval("document.querySelector('#letters input[value=\"1\"]').click()");
  page_->click("#new-printer button");
  page_->wait_for("document.getElementById('printers').textContent.includes('lab-printer')");
  std::ifstream made(farm_.root + "/db/lab-printer.toml");
  EXPECT_THAT((std::string{std::istreambuf_iterator<char>(made), {}}), HasSubstr("mirror = \"x\""));
  EXPECT_THAT(page_->complaints(), IsEmpty());
}

TEST_F(FarmProxy, LargePartsComeThroughAndOtherSitesDoNot) {
  serve();
  httplib::Client client("127.0.0.1", nginx_->port);
  client.set_read_timeout(60);
  const httplib::Headers mine{{"Authorization", "Bearer " + kOperator},
                              {"Origin", fmt::format("http://127.0.0.1:{}", nginx_->port)}};
  // More than nginx lets through unless it is told otherwise.
  const std::string part(3 << 20, 'x');
  const auto sent =
      client.Put("/lab/resin/api/v1/parts/large.stl", mine, part, "application/octet-stream");
  ASSERT_EQ(status_of(sent), 201) << (sent ? sent->body : "");
  EXPECT_THAT(sent->body, HasSubstr("upload:"));
  // Another site's page is refused as without a proxy.
  httplib::Headers other = mine;
  other.erase("Origin");
  other.emplace("Origin", "http://elsewhere.example");
  EXPECT_EQ(status_of(client.Put("/lab/resin/api/v1/parts/a.stl", other, "x", "text/plain")), 403);
  // A proxy that does not say which host was asked for: nothing can be changed, and the answer says why.
  const auto forgets = client.Put("/forgets/api/v1/parts/a.stl", mine, "x", "text/plain");
  EXPECT_EQ(status_of(forgets), 403);
  EXPECT_THAT(forgets->body, HasSubstr("origin"));
  // Outside of the path there is nothing of the farm.
  EXPECT_EQ(status_of(client.Get("/api/v1/me")), 404);
  // The whole answer of a stack's file, and a part of it, as programs ask for that.
  EXPECT_EQ(status_of(client.Get("/lab/resin/healthz")), 200);
}

// Of all pages, also those of the bridge: an address that begins at the root of a server leaves the path.
TEST(Pages, NoAddressBeginsAtTheRoot) {
  int looked_at = 0;
  for (const char* folder :
       {"/farm/views/page", "/firmware-bridge/view/page", "/libslicecorr/report/page"}) {
    for (const auto& entry : fs::directory_iterator(std::string(SLICECORR_SOURCE_DIR) + folder)) {
      const std::string ending = entry.path().extension().string();
      if (ending != ".html" && ending != ".js") continue;
      std::ifstream in(entry.path());
      const std::string text{std::istreambuf_iterator<char>(in), {}};
      ++looked_at;
      static const std::regex at_root(
          R"x((href|src|action)=["']/|(fetch|open|ask|read|change|get|link|blobUrl)\((['"]PUT['"], )?['"`]/|(href|src|path) = ['"`]/)x");
      std::smatch found;
      EXPECT_FALSE(std::regex_search(text, found, at_root))
          << entry.path() << ": " << found.str() << found.suffix().str().substr(0, 60);
    }
  }
  EXPECT_GE(looked_at, 8);
}

}  // namespace
}  // namespace slicecorr::farm
