// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The farm's pages in a real browser: on a desk, on a phone, light, dark, on paper.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <httplib.h>

#include <nlohmann/json.hpp>
#include <thread>

#include "devtools.hpp"
#include "farm_filled.hpp"
#include "slicecorr/farm/morning.hpp"
#include "slicecorr/farm/serve.hpp"
#include "slicecorr/farm/status.hpp"

namespace slicecorr::farm {
namespace {

namespace fs = std::filesystem;
using slicecorr::test::BrowserFolder;
using slicecorr::test::chromium;
using slicecorr::test::DrivenPage;
using test::Farm;
using test::fill;
using ::testing::HasSubstr;
using ::testing::Not;

/// A night that reads like one: two workers from 20:00 to 5:00, a few failures, some from the
/// cache.
void fill_night(Farm& farm, int jobs) {
  const char* parts[] = {"gyroid",  "elephant", "benchy",     "bracket", "dental-arch",
                         "lattice", "manifold", "lens-mount", "turbine", "ring-size-7"};
  std::uint32_t state = 12345;
  const auto chance = [&] {
    state = state * 1664525U + 1013904223U;
    return static_cast<double>(state >> 8) / (1 << 24);
  };
  farm.set("max-attempts", "2");
  farm.set("night", "20:00-07:00");
  std::vector<NewJob> list;
  for (int i = 0; i < jobs; ++i) {
    NewJob j = farm.job(fmt::format("{}-{}", parts[i % 10], i / 10 + 1));
    j.user = i % 3 == 0 ? "bert" : "anna";
    if (i % 7 == 0) j.labels = {"clear"};
    j.expected_s = 500;
    list.push_back(j);
  }
  farm.submit(list);
  struct Running {
    Claim claim;
    double end_s;
  };
  std::vector<Running> running;
  double now_s = 0;
  const double night_s = 9 * 3600;
  while (now_s < night_s) {
    while (running.size() < 2) {
      const Claim claim = farm.claim();
      running.push_back({claim, now_s + 200 + 900 * chance()});
    }
    const auto first =
        std::min_element(running.begin(), running.end(),
                         [](const auto& a, const auto& b) { return a.end_s < b.end_s; });
    if (first->end_s > night_s) break;
    const double step = first->end_s - now_s;
    now_s = first->end_s;
    const Claim claim = first->claim;
    running.erase(first);
    farm.clock.pass(step);
    const double luck = chance();
    AttemptEnd end;
    end.node = "night-owl";
    if (luck < 0.06) {
      farm.give_up(claim, 0, Reason::bad_input,
                   claim.job.name + ".stl: 12 triangles expected, the file ends after 7",
                   "reading " + claim.job.name +
                       ".stl\nsizes: 41.2 x 30.0 x 22.8 mm\nerror: 12 triangles expected, the file "
                       "ends after 7\n");
    } else if (luck < 0.14) {
      farm.give_up(claim, 0, Reason::worker_killed, "ended by signal 9", "slicing\ncorrecting\n");
    } else {
      farm.finish(claim, 0, test::figures_with(2 + 40 * chance() * chance(), luck > 0.95 ? 12 : 0));
    }
  }
  farm.clock.pass(night_s - now_s);
  int n = 0;
  for (const Running& r : running) {
    farm.queue.record_progress({{r.claim.token, n == 0 ? "correct" : "report", "night-owl",
                                 n == 0 ? 0.42 : 0.87, n == 0 ? 323 : 670}});
    ++n;
  }
  farm.queue.renew(farm.service, {}, "working");
}

std::int64_t last_evening() {
  return moment_of("20:00", system_clock().wall_ms() - 10 * 3600'000, "");
}

class FarmPage : public ::testing::Test {
 protected:
  void SetUp() override {
    if (chromium().empty()) GTEST_SKIP() << "chromium is not installed (scripts/setup --all)";
  }
  static fs::path folder_of_pictures() {
    return fs::path(SLICECORR_BIN_DIR).parent_path() / "farm-pictures";
  }
  BrowserFolder folder_;
};

/// Lines with SGR sequences as markup.
std::string terminal_page(const std::vector<std::string>& lines) {
  std::string html =
      "<!doctype html><meta "
      "charset=utf-8><style>body{margin:0;background:#14171a;color:#e6e9ec}pre{margin:0;padding:14px;font:14px/1.3 "
      "'DejaVu Sans "
      "Mono',monospace}.c1{font-weight:700}.c2{color:#8b95a0}.c31{color:#ff8a80}.c32{color:#5fd3a8}.c36{color:#8ad8f0}</style><pre>";
  for (const std::string& line : lines) {
    for (std::size_t i = 0; i < line.size(); ++i) {
      if (line[i] == '\033') {
        const std::size_t end = line.find('m', i);
        const std::string code = line.substr(i + 2, end - i - 2);
        html += code == "0" ? "</span>" : "<span class=c" + code + ">";
        i = end;
      } else {
        html += line[i] == '<' ? "&lt;" : line[i] == '&' ? "&amp;" : std::string(1, line[i]);
      }
    }
    html += "\n";
  }
  return html + "</pre>";
}

TEST_F(FarmPage, PictureOfTheLiveView) {
  Farm farm(last_evening());
  fill_night(farm, 130);
  auto model = farm.model();
  std::ofstream(folder_.path / "watch.html") << terminal_page(
      live_frame(read_live(model, farm.folder, 30, farm.clock), farm.folder, 112, 30, true));
  const fs::path out = folder_of_pictures() / "watch.png";
  fs::create_directories(out.parent_path());
  fs::remove(out);
  DrivenPage page;
  page.look_like(975, 575, false);
  page.open("file://" + (folder_.path / "watch.html").string());
  page.picture(out);
  ASSERT_TRUE(fs::exists(out));
  EXPECT_GT(fs::file_size(out), 10'000U);
}

TEST_F(FarmPage, MorningOnDeskPhoneAndPaper) {
  Farm farm(last_evening());
  fill_night(farm, 130);
  auto model = farm.model();
  MorningOptions options;
  options.from_ms = last_evening();
  const std::string html = morning_page(read_morning(farm.folder, model, options, farm.clock),
                                        {LinkTo::Kind::files, folder_.path.string()});
  std::ofstream(folder_.path / "page.html") << html;
  const std::string address = "file://" + (folder_.path / "page.html").string();
  DrivenPage page;
  page.looks(address, folder_of_pictures(), "morning", "true");
  // Nothing is wider than a phone, as which it was seen last: only boxes that scroll by themselves
  // hold wide things.
  EXPECT_EQ(page.eval("document.documentElement.scrollWidth"), 400);
  const auto paper = folder_of_pictures() / "morning.pdf";
  fs::remove(paper);
  page.print(paper);
  ASSERT_TRUE(fs::exists(paper));
  EXPECT_GT(fs::file_size(paper), 30'000U);
}

class LivePage : public FarmPage {
 protected:
  void serve(Farm& farm, ServeOptions options = {}) {
    options.clock = &farm.clock;
    server_ = std::make_unique<FarmServer>(farm.folder, options);
    thread_ = std::thread([this] { server_->run(); });
  }
  void TearDown() override {
    if (!server_) return;
    server_->stop();
    thread_.join();
  }
  /// The page once an expression holds; what its scripts and its policy complain of is in `log_`.
  std::string dom(const std::string& path, const std::string& ready) {
    DrivenPage page;
    page.look_like(1280, 2000, false);
    page.open(server_->address() + path);
    page.wait_for(ready);
    log_.clear();
    for (const std::string& c : page.complaints()) log_ += c + "\n";
    return page.dom();
  }
  std::unique_ptr<FarmServer> server_;
  std::thread thread_;
  std::string log_;
};

TEST_F(LivePage, ShowsTheFarmAsText) {
  Farm farm;
  fill(farm);
  serve(farm);
  const std::string page = dom("/", "document.body.dataset.ready === 'yes'");
  EXPECT_THAT(page, HasSubstr("data-ready=\"yes\"")) << log_;
  EXPECT_THAT(page, HasSubstr("462 of 770 layers"));
  EXPECT_THAT(page, HasSubstr("benchy-日本"));
  EXPECT_THAT(page, HasSubstr("1 to 4 of 4"));
  EXPECT_THAT(page, HasSubstr("<b>11</b><span>failed</span>"));
  // The policy blocked nothing, and no name became an element.
  EXPECT_THAT(log_, Not(HasSubstr("Content Security Policy")));
  EXPECT_THAT(log_, Not(HasSubstr("Uncaught")));
  EXPECT_THAT(page, Not(HasSubstr("<img src=\"x\"")));
}

TEST_F(LivePage, AsksForTheTokenBeyondTheMachine) {
  Farm farm;
  fill(farm);
  ServeOptions options;
  options.host = "0.0.0.0";
  options.token = std::string(40, 'k');
  serve(farm, options);
  const std::string page =
      dom("/", "document.body.innerText.includes('shown to those who have its token')");
  EXPECT_THAT(page, Not(HasSubstr("elephant")));
}

TEST_F(LivePage, ReportAndPartOfTheServer) {
  Farm farm;
  const auto f = fill(farm);
  serve(farm);
  const std::string page = dom("/report", "true");
  EXPECT_THAT(page, HasSubstr("What failed, and why"));
  EXPECT_THAT(page, HasSubstr(fmt::format("\"api/v1/jobs/{}/files/html", f.nasty)));
  EXPECT_THAT(page, HasSubstr("&lt;img src=x onerror=alert(1)&gt;"));
  EXPECT_THAT(page, Not(HasSubstr("<img src=\"x\"")));
  // The styles are there: the policy names them by their hashes.
  EXPECT_THAT(log_, Not(HasSubstr("Content Security Policy")));
  // A part's page may run its own scripts, and reach nothing of the farm.
  const std::string evil =
      "<!doctype html><title>t</title><p "
      "id=o></p><script>document.getElementById('o').textContent='ran "
      "'+self.origin;fetch('/api/v1/overview').then(()=>document.title='READ',()=>document.title='kept "
      "out')</script>";
  NewJob urgent = farm.job("evil");
  urgent.priority = 100;
  farm.submit({urgent});
  const Claim claim = farm.claim();
  ASSERT_EQ(claim.job.name, "evil");
  test::write_file(farm.folder.results(claim.job.id) + "/" + claim.job.name + ".html", evil);
  ResultRecord result;
  result.figures = test::figures_with(1);
  result.files = {{"html", static_cast<std::int64_t>(evil.size()), std::string(64, 'a')}};
  ASSERT_TRUE(farm.queue.begin_commit(claim.token));
  ASSERT_TRUE(farm.queue.finish(claim.token, result, {}, false));
  const std::string part =
      dom(fmt::format("/api/v1/jobs/{}/files/html", claim.job.id), "document.title !== 't'");
  EXPECT_THAT(part, HasSubstr("ran null"));
  EXPECT_THAT(part, HasSubstr("<title>kept out</title>"));
  EXPECT_THAT(log_, HasSubstr("Content Security Policy"));
}

TEST_F(LivePage, PicturesOnDeskAndPhone) {
  Farm farm(last_evening());
  fill_night(farm, 130);
  serve(farm);
  DrivenPage page;
  page.looks(server_->address() + "/", folder_of_pictures(), "live",
             "document.body.dataset.ready === 'yes'");
}

}  // namespace
}  // namespace slicecorr::farm
