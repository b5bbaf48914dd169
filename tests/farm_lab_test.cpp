// What a lab does over HTTP beside jobs: accounts, studies, resins, printers, machines.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "farm_served.hpp"
#include "ladder.hpp"
#include "run_program.hpp"
#include "serve/plate.hpp"
#include "serve/routes.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::body_of;
using test::Farm;
using test::fill;
using test::Filled;
using test::kToken;
using test::Served;
using test::status_of;
using test::with_token;
using ::testing::HasSubstr;
using ::testing::Not;

const std::string kLook(40, 'l'), kSubmit(40, 's'), kOther(40, 'o'), kOperate(40, 'p');

ServeOptions with_accounts() {
  ServeOptions options;
  options.accounts = {{"lena", Role::look, kLook},
                      {"sam", Role::submit, kSubmit},
                      {"olga", Role::submit, kOther},
                      {"pia", Role::operate, kOperate}};
  options.children.programs = SLICECORR_BIN_DIR;
  return options;
}

httplib::Client client_of(const Served& served, const std::string& token) {
  httplib::Client c = served.client();
  if (!token.empty()) c.set_default_headers({{"Authorization", "Bearer " + token}});
  return c;
}

httplib::Result post(httplib::Client& client, const std::string& path, const json& body) {
  return client.Post(path.c_str(), body.dump(), "application/json");
}

std::string message_of(const httplib::Result& result) {
  const json body = body_of(result);
  return body.contains("error") ? body["error"]["message"].get<std::string>() : "";
}

std::string upload(httplib::Client& client, const std::string& name, const std::string& bytes) {
  const auto answer = client.Put(("/api/v1/parts/" + name).c_str(), bytes, "model/stl");
  return body_of(answer)["part"];
}

std::string bytes_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// The ladder of figure 2.2, uploaded.
std::string ladder_of(Farm& farm, httplib::Client& client) {
  const std::string path = farm.root + "/ladder.stl";
  slicecorr::test::write_stl(path, slicecorr::test::ladder());
  return upload(client, "ladder.stl", bytes_of(path));
}

json ended(httplib::Client& client, const std::string& token) {
  json state;
  for (int i = 0; i < 1200; ++i) {
    state = body_of(client.Get(("/api/v1/studies/" + token).c_str()));
    if (state["state"] != "waiting" && state["state"] != "running") return state;
    ::usleep(50'000);
  }
  return state;
}

/// Starts a study and waits for its end.
json study(httplib::Client& client, const json& request) {
  const auto answer = post(client, "/api/v1/studies", request);
  EXPECT_EQ(status_of(answer), 202) << answer->body;
  return ended(client, body_of(answer).value("study", ""));
}

std::string file_of(httplib::Client& client, const json& study, const std::string& name) {
  const auto answer = client.Get(
      ("/api/v1/studies/" + study["study"].get<std::string>() + "/files/" + name).c_str());
  EXPECT_EQ(status_of(answer), 200) << name;
  return answer ? answer->body : "";
}

json of_ladder(const char* kind, const std::string& part) {
  return {{"kind", kind},
          {"parts", {part}},
          {"printer", "dual-wavelength-dlp"},
          {"resin", "benchy-resin"},
          {"layer_um", 50}};
}

// --- what is there, and who may -----------------------------------------------------------------

json description() {
  return json::parse(bytes_of(std::string(SLICECORR_SOURCE_DIR) + "/farm/views/page/openapi.json"));
}

TEST(Routes, AllAreDescribedAndNoOthers) {
  json described = description()["paths"];
  for (const detail::Route& route : detail::routes()) {
    std::string method = route.method;
    std::transform(method.begin(), method.end(), method.begin(), ::tolower);
    ASSERT_TRUE(described.contains(route.path)) << route.path;
    ASSERT_TRUE(described[route.path].contains(method)) << method << " " << route.path;
    const json& operation = described[route.path][method];
    EXPECT_EQ(operation["x-role"], route.role ? name_of(*route.role) : "none") << route.path;
    EXPECT_FALSE(operation["summary"].get<std::string>().empty()) << route.path;
    described[route.path].erase(method);
    if (described[route.path].empty()) described.erase(route.path);
  }
  EXPECT_TRUE(described.empty()) << described.dump(1);
}

/// Every reference of the description leads somewhere.
void follow(const json& whole, const json& at) {
  if (at.is_object() && at.contains("$ref")) {
    const std::string ref = at["$ref"];
    EXPECT_TRUE(whole.contains(json::json_pointer(ref.substr(1)))) << ref;
  }
  if (at.is_structured()) {
    for (const auto& [key, value] : at.items()) follow(whole, value);
  }
}

TEST(Routes, TheDescriptionIsServedAndWhole) {
  Farm farm;
  const Served served(farm);
  const json served_description = body_of(served.client().Get("/api/v1/openapi.json"));
  EXPECT_EQ(served_description, description());
  follow(served_description, served_description);
}

/// A request for a route with something in the place of what is in braces.
httplib::Result ask(httplib::Client& client, const detail::Route& route, const Filled& f) {
  std::string path = route.path;
  for (const auto& [what, value] :
       {std::pair<std::string, std::string>{"{id}", std::to_string(f.queued)},
        {"{ending}", "html"},
        {"{file}", "live.js"},
        {"{study}", std::string(32, 'a')},
        {"{layer}", "0.png"},
        {"{name}", path.find("parts") != std::string::npos ? "a.stl" : "egg-resin"}}) {
    const auto at = path.find(what);
    if (at != std::string::npos) path.replace(at, what.size(), value);
  }
  const std::string method = route.method;
  if (method == "GET") return client.Get(path.c_str());
  if (method == "PUT") return client.Put(path.c_str(), "solid", "model/stl");
  return client.Post(path.c_str(), "{}", "application/json");
}

TEST(Routes, EachAsksForItsRole) {
  Farm farm;
  const Filled f = fill(farm);
  ServeOptions options = with_accounts();
  options.host = "0.0.0.0";
  const Served served(farm, options);
  struct Case {
    const std::string* token;
    std::optional<Role> role;
  };
  const std::string none;
  for (const Case& c : {Case{&none, {}}, Case{&kLook, Role::look}, Case{&kSubmit, Role::submit},
                        Case{&kOperate, Role::operate}}) {
    auto client = client_of(served, *c.token);
    for (const detail::Route& route : detail::routes()) {
      const auto answer = ask(client, route, f);
      const std::string what = fmt::format("{} {} as {}", route.method, route.path,
                                           c.role ? name_of(*c.role) : "nobody");
      const std::string code = answer && answer->status >= 400
                                   ? body_of(answer)["error"]["code"].get<std::string>()
                                   : "";
      if (route.role && !c.role) {
        EXPECT_EQ(status_of(answer), 401) << what;
      } else if (route.role && *route.role > *c.role) {
        EXPECT_EQ(status_of(answer), 403) << what;
        EXPECT_EQ(code, "role") << what;
      } else {
        EXPECT_NE(status_of(answer), 401) << what << answer->body;
        EXPECT_THAT(message_of(answer), Not(HasSubstr("this needs one that may"))) << what;
        // Somebody answers for every route.
        EXPECT_THAT(message_of(answer), Not(HasSubstr("nothing at this path"))) << what;
      }
    }
  }
}

TEST(Accounts, FilesAreReadStrictly) {
  Farm farm;
  const std::string path = farm.root + "/accounts";
  const auto with = [&](const std::string& text, unsigned mode = 0600) {
    test::write_file(path, text);
    fs::permissions(path, static_cast<fs::perms>(mode));
    return read_accounts_file(path);
  };
  const auto read = with("# who may\n\nlook lena " + kLook + "\n operate\tpia " + kOperate + "\n");
  ASSERT_EQ(read.size(), 2U);
  EXPECT_EQ(read[0].name, "lena");
  EXPECT_EQ(read[0].role, Role::look);
  EXPECT_EQ(read[1].role, Role::operate);
  EXPECT_EQ(read[1].token, kOperate);
  EXPECT_THROW(with("look lena " + kLook + "\n", 0644), InputError);
  for (const std::string& bad :
       {std::string(), std::string("# none\n"), "root lena " + kLook, "look lena",
        "look lena short", "look lena " + kLook + " more", "look a " + kLook + "\nlook b " + kLook,
        "look a " + kLook + "\nsubmit a " + kSubmit}) {
    EXPECT_THROW(with(bad), InputError) << bad;
  }
  try {
    with("look lena " + kLook + "\nroot b " + kOther + "\n");
    FAIL();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("line 2"));
  }
}

TEST(Accounts, WhoAsksAndWhoseJobs) {
  Farm farm;
  farm.submit({farm.job("of-anna")});
  NewJob of_sam = farm.job("of-sam");
  of_sam.user = "sam";
  const JobId sams = farm.submit({of_sam})[0];
  ServeOptions options = with_accounts();
  options.submit = make_submitter({farm.folder, {}, "web"});
  const Served served(farm, options);
  auto sam = client_of(served, kSubmit), olga = client_of(served, kOther),
       pia = client_of(served, kOperate), nobody = client_of(served, "");
  EXPECT_EQ(body_of(sam.Get("/api/v1/me")), (json{{"name", "sam"}, {"role", "submit"}}));
  EXPECT_EQ(body_of(nobody.Get("/api/v1/me")), (json{{"name", ""}, {"role", "look"}}));
  const std::string cancel = fmt::format("/api/v1/jobs/{}/cancel", sams);
  EXPECT_EQ(status_of(post(olga, cancel, json::object())), 403);
  EXPECT_EQ(farm.model().job(sams)->state, JobState::queued);
  EXPECT_EQ(status_of(post(sam, cancel, json::object())), 200);
  EXPECT_EQ(status_of(post(sam, fmt::format("/api/v1/jobs/{}/retry", sams), json::object())), 200);
  EXPECT_EQ(status_of(post(pia, cancel, json::object())), 200);
  // Jobs are those of the account, whatever is said; who operates may name somebody.
  const std::string part = ladder_of(farm, sam);
  json job = {{"part", part},
              {"printer", "dual-wavelength-dlp"},
              {"resin", "benchy-resin"},
              {"layer_um", 50},
              {"speed_mm_h", 800},
              {"user", "olga"}};
  auto answer = post(sam, "/api/v1/jobs", {{"defaults", {{"user", "olga"}}}, {"jobs", {job}}});
  ASSERT_EQ(status_of(answer), 201) << answer->body;
  EXPECT_EQ(farm.model().job(body_of(answer)["ids"][0])->user, "sam");
  job["name"] = "second";
  answer = post(pia, "/api/v1/jobs", {{"jobs", {job}}});
  ASSERT_EQ(status_of(answer), 201) << answer->body;
  EXPECT_EQ(farm.model().job(body_of(answer)["ids"][0])->user, "olga");
}

TEST(Accounts, TicketsAreForOnePath) {
  Farm farm;
  const Filled f = fill(farm);
  ServeOptions options = with_accounts();
  options.host = "0.0.0.0";
  const Served served(farm, options);
  auto lena = client_of(served, kLook), nobody = client_of(served, "");
  const std::string path = fmt::format("/api/v1/jobs/{}/files/html", f.done[0]);
  const std::string with = body_of(post(lena, "/api/v1/tickets", {{"path", path}}))["path"];
  EXPECT_THAT(with, HasSubstr(path + "?ticket="));
  EXPECT_EQ(status_of(nobody.Get(path.c_str())), 401);
  EXPECT_EQ(status_of(nobody.Get(with.c_str())), 200);
  const std::string ticket = with.substr(with.find('?'));
  for (const std::string& other :
       {fmt::format("/api/v1/jobs/{}/files/html", f.done[1]), std::string("/report"),
        std::string("/api/v1/overview"), std::string("/metrics")}) {
    EXPECT_EQ(status_of(nobody.Get((other + ticket).c_str())), 401) << other;
  }
  EXPECT_EQ(status_of(nobody.Get((path + "?ticket=" + std::string(32, 'a')).c_str())), 401);
  for (const char* bad : {"/metrics", "/api/v1/jobs", "/etc/passwd", "", "/api/v1/overview"}) {
    EXPECT_EQ(status_of(post(lena, "/api/v1/tickets", {{"path", bad}})), 400) << bad;
  }
  EXPECT_EQ(status_of(post(nobody, "/api/v1/tickets", {{"path", path}})), 401);
}

// --- studies ------------------------------------------------------------------------------------

TEST(Studies, APlateShowsWhatIsSliced) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  const json s = study(sam, of_ladder("plate", ladder_of(farm, sam)));
  ASSERT_EQ(s["state"], "done") << s.dump();
  const json plate = json::parse(file_of(sam, s, "plate.json"));
  EXPECT_EQ(plate["layers"], 50);
  EXPECT_EQ(plate["triangles"], 48);
  EXPECT_EQ(plate["shown_triangles"], 48);
  EXPECT_EQ(plate["plate_mm"], (json{64.0, 40.0}));
  // 4 x 2 x 2.5 mm in the middle of the plate.
  const std::vector<double> lower = plate["lower_mm"], upper = plate["upper_mm"];
  const std::vector<double> expected_lower{30, 19, 0}, expected_upper{34, 21, 2.5};
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(lower[k], expected_lower[k], 1e-6);
    EXPECT_NEAR(upper[k], expected_upper[k], 1e-6);
  }
  EXPECT_NEAR(plate["volume_ml"].get<double>(), (2 * 1 * 2 * 2.5 + 2 * 2 * 2 * 0.5) * 1e-3, 1e-6);
  // Triangles: places within the box, in steps of 1/65535.
  const std::string bin = file_of(sam, s, "plate.bin");
  ASSERT_EQ(bin.size(), 32U + 18 * 48);
  EXPECT_EQ(bin.substr(0, 4), "SCP1");
  float box[6];
  std::memcpy(box, bin.data() + 8, sizeof box);
  std::set<long> heights;
  for (std::size_t i = 0; i < 48 * 3; ++i) {
    std::uint16_t at[3];
    std::memcpy(at, bin.data() + 32 + 6 * i, sizeof at);
    heights.insert(std::lround(1000 * (box[2] + at[2] * (box[5] - box[2]) / 65535.0)));
  }
  EXPECT_EQ(heights, (std::set<long>{0, 550, 1050, 1550, 2050, 2500}));
  // Layers: two rails of 20 x 40 pixels, a rung between them in slices 11 to 20.
  const std::string token = s["study"];
  EXPECT_EQ(plate["box_px"], (json{600, 380, 680, 420}));
  for (const auto& [layer, lit] :
       {std::pair{0, 1600}, {10, 1600}, {11, 3200}, {20, 3200}, {49, 1600}}) {
    const auto answer =
        sam.Get(fmt::format("/api/v1/studies/{}/layers/{}.png", token, layer).c_str());
    ASSERT_EQ(status_of(answer), 200);
    const GreyImage image = decode_png({answer->body.begin(), answer->body.end()}, 80, 40, "layer");
    EXPECT_EQ(std::count(image.pixels.begin(), image.pixels.end(), 255), lit) << layer;
  }
  for (const char* bad :
       {"50.png", "-1.png", "01.png", "x.png", "..%2fplate.json", "4294967296.png"}) {
    EXPECT_EQ(status_of(sam.Get(("/api/v1/studies/" + token + "/layers/" + bad).c_str())), 404)
        << bad;
  }
  for (const char* bad : {"design.uvj", "..%2f..%2ffarm.sqlite", "layers.bin", "check.html"}) {
    EXPECT_EQ(status_of(sam.Get(("/api/v1/studies/" + token + "/files/" + bad).c_str())), 404)
        << bad;
  }
}

TEST(Studies, AnArchiveHasLayersAndCells) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  slicecorr::test::write_stl(farm.root + "/ladder.stl", slicecorr::test::ladder());
  const auto sliced = slicecorr::test::run_program(
      {std::string(SLICECORR_BIN_DIR) + "/slicecorr", "slice", farm.root + "/ladder.stl",
       "--layer-um", "50", "--printer", "dual-wavelength-dlp", "-o", farm.root + "/ladder.uvj"});
  ASSERT_EQ(sliced.exit_code, 0) << sliced.err;
  const std::string part = upload(sam, "ladder.uvj", bytes_of(farm.root + "/ladder.uvj"));
  json request = of_ladder("plate", part);
  request.erase("layer_um");
  const json s = study(sam, request);
  ASSERT_EQ(s["state"], "done") << s.dump();
  const json plate = json::parse(file_of(sam, s, "plate.json"));
  EXPECT_EQ(plate["from"], "slices");
  EXPECT_EQ(plate["layers"], 50);
  const std::vector<double> lower = plate["lower_mm"], upper = plate["upper_mm"];
  EXPECT_NEAR(lower[0], 30, 1e-6);
  EXPECT_NEAR(lower[1], 19, 1e-6);
  EXPECT_NEAR(upper[2], 2.5, 1e-6);
  // Pixels are cells here: faces of 80 x 40 x 50 cells. Rails and rungs from all sides: each quad is
  // two triangles.
  const int rail = 2 * (20 * 40) + 2 * 50 * (20 + 40), rung = 40 * 40 + 40 * 10;
  // A rung covers 40 x 10 faces of either rail and has none at its own ends.
  EXPECT_EQ(plate["shown_triangles"], 2 * (2 * rail + 2 * 2 * rung - 2 * 2 * 40 * 10));
  const json check = study(sam, [&] {
    json r = request;
    r["kind"] = "check";
    r["speed_mm_h"] = 800;
    return r;
  }());
  ASSERT_EQ(check["state"], "done") << check.dump();
  EXPECT_EQ(json::parse(file_of(sam, check, "check.json"))["layer_um"], 50.0);
  EXPECT_EQ(file_of(sam, check, "section.png").substr(1, 3), "PNG");
}

TEST(Studies, APlanIsThatOfTheProgram) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  json request = of_ladder("plan", ladder_of(farm, sam));
  request["tolerance_um"] = 25;
  const json s = study(sam, request);
  ASSERT_EQ(s["state"], "done") << s.dump();
  const json plan = json::parse(file_of(sam, s, "plan.json"));
  const auto direct = slicecorr::test::run_program({std::string(SLICECORR_BIN_DIR) + "/slicecorr",
                                                    "plan", farm.root + "/ladder.stl", "--layer-um",
                                                    "50", "--printer", "dual-wavelength-dlp",
                                                    "--resin", "benchy-resin", "--json", "-"});
  ASSERT_EQ(direct.exit_code, 0) << direct.err;
  EXPECT_EQ(plan["speed_mm_h"], json::parse(direct.out)["speed_mm_h"]);
  EXPECT_EQ(plan["limit"], json::parse(direct.out)["limit"]);
  EXPECT_THAT(file_of(sam, s, "plan.svg"), HasSubstr("<svg"));
  // What can't be printed says so, with the exit code of physics.
  request["tolerance_um"] = 0.001;
  const json refused = study(sam, request);
  EXPECT_EQ(refused["state"], "failed");
  EXPECT_EQ(refused["exit_code"], 3);
  EXPECT_FALSE(refused["message"].get<std::string>().empty());
  EXPECT_THAT(refused["message"].get<std::string>(), Not(HasSubstr(farm.root)));
}

TEST(Studies, ACheckHasFiguresAndTheWorstPlace) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  json request = of_ladder("check", ladder_of(farm, sam));
  request["speed_mm_h"] = 800;
  const json s = study(sam, request);
  ASSERT_EQ(s["state"], "done") << s.dump();
  const json figures = json::parse(file_of(sam, s, "check.json"));
  EXPECT_LT(figures["height_error_um"]["max_abs"].get<double>(),
            figures["uncorrected"]["height_error_um"]["max_abs"].get<double>());
  EXPECT_EQ(file_of(sam, s, "section.png").substr(1, 3), "PNG");
  const auto page =
      sam.Get(("/api/v1/studies/" + s["study"].get<std::string>() + "/files/check.html").c_str());
  EXPECT_THAT(page->get_header_value("Content-Security-Policy"), HasSubstr("sandbox"));
  // The part is named, its folders are not.
  request["parts"] = {upload(sam, "broken.stl", std::string(200, 'x'))};
  const json broken = study(sam, request);
  EXPECT_EQ(broken["state"], "failed");
  EXPECT_EQ(broken["exit_code"], 2);
  EXPECT_THAT(broken["message"].get<std::string>(), HasSubstr("broken.stl"));
  EXPECT_THAT(broken["message"].get<std::string>(), Not(HasSubstr("uploads/")));
}

TEST(Studies, RefusesWhatIsNoStudy) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto sam = client_of(served, kSubmit);
  const std::string part = ladder_of(farm, sam);
  for (const json& bad :
       std::vector<json>{{{"kind", "shell"}},
                         {{"kind", 7}},
                         {{"parts", {"/etc/passwd"}}},
                         {{"parts", {farm.root + "/ladder.stl"}}},
                         {{"parts", {"upload:../../ladder.stl"}}},
                         {{"parts", {"upload:" + std::string(32, 'a') + "/ladder.stl"}}},
                         {{"parts", json::array()}},
                         {{"parts", part}},
                         {{"parts", {part, 7}}},
                         {{"printer", "/etc/printer.toml"}},
                         {{"printer", "../printer"}},
                         {{"printer", "--help"}},
                         {{"printer", "printer.toml"}},
                         {{"printer", "a b"}},
                         {{"printer", nullptr}},
                         {{"resin", "x;y"}},
                         {{"layer_um", "50"}},
                         {{"layer_um", nullptr}},
                         {{"tolerance_um", true}},
                         {{"mode", "-x"}},
                         {{"mode", "a=b"}},
                         {{"rotate_deg", {1, 2}}},
                         {{"rotate_deg", "0,0,0"}},
                         {{"-o", "/tmp/x"}},
                         {{"json", "/tmp/x"}}}) {
    json request = of_ladder("plan", part);
    request.update(bad);
    const auto answer = post(sam, "/api/v1/studies", request);
    EXPECT_EQ(status_of(answer), 400) << bad.dump() << answer->body;
    EXPECT_THAT(answer->body, Not(HasSubstr("/tmp/x"))) << bad.dump();
  }
  for (const char* token : {"..", "..%2f..", "a", "00000000000000000000000000000000"}) {
    EXPECT_EQ(status_of(sam.Get((std::string("/api/v1/studies/") + token).c_str())), 404) << token;
  }
}

/// A folder of programs, each a script.
std::string scripts(Farm& farm, const std::map<std::string, std::string>& texts) {
  const std::string folder = farm.root + "/programs";
  for (const auto& [name, text] : texts) {
    test::write_file(folder + "/" + name, "#!/bin/sh\n" + text);
    fs::permissions(folder + "/" + name, fs::perms::owner_all);
  }
  return folder;
}

TEST(Studies, RunBesideTheServerAndEndWhenTold) {
  Farm farm;
  ServeOptions options = with_accounts();
  options.children.programs = scripts(farm, {{"slicecorr", "echo begun > begun; sleep 600\n"}});
  options.children.most_waiting = 1;
  const Served served(farm, options);
  auto sam = client_of(served, kSubmit), olga = client_of(served, kOther);
  const json request = of_ladder("plan", ladder_of(farm, sam));
  const std::string first = body_of(post(sam, "/api/v1/studies", request))["study"];
  const auto state = [&](const std::string& token) {
    return body_of(sam.Get(("/api/v1/studies/" + token).c_str()))["state"];
  };
  for (int i = 0; i < 200 && state(first) != "running"; ++i) ::usleep(20'000);
  ASSERT_EQ(state(first), "running");
  for (int i = 0; i < 200 && !fs::exists(farm.root + "/studies/" + first + "/begun"); ++i) {
    ::usleep(20'000);
  }
  const std::string second = body_of(post(sam, "/api/v1/studies", request))["study"];
  EXPECT_EQ(body_of(sam.Get(("/api/v1/studies/" + second).c_str()))["before"], 0);
  EXPECT_EQ(status_of(post(sam, "/api/v1/studies", request)), 503);
  // The server answers meanwhile.
  EXPECT_EQ(status_of(sam.Get("/api/v1/overview")), 200);
  EXPECT_EQ(status_of(sam.Get(("/api/v1/studies/" + first + "/files/plan.json").c_str())), 409);
  EXPECT_EQ(status_of(post(olga, "/api/v1/studies/" + first + "/cancel", json::object())), 403);
  for (const std::string& token : {second, first}) {
    EXPECT_EQ(status_of(post(sam, "/api/v1/studies/" + token + "/cancel", json::object())), 200);
    EXPECT_EQ(ended(sam, token)["state"], "cancelled");
    EXPECT_EQ(status_of(post(sam, "/api/v1/studies/" + token + "/cancel", json::object())), 409);
  }
  // Nothing of it runs on: a third one begins.
  const std::string third = body_of(post(sam, "/api/v1/studies", request))["study"];
  for (int i = 0; i < 200 && state(third) != "running"; ++i) ::usleep(20'000);
  EXPECT_EQ(state(third), "running");
}  // the server ends the third one

TEST(Studies, ProgramsAreBounded) {
  Farm farm;
  ServeOptions options = with_accounts();
  options.children.programs =
      scripts(farm, {{"slicecorr",
                      "case $1 in plan) sleep 600;; run) head -c 3000000 /dev/zero > big;; "
                      "slice) echo design; env > seen; pwd >> seen; exit 7;; esac\n"},
                     {"resinctl", "echo wrote > $HOME/never; exit 1\n"}});
  options.children.study_s = 0.5;
  options.children.file_bytes = 1 << 20;
  const Served served(farm, options);
  auto sam = client_of(served, kSubmit);
  const std::string part = ladder_of(farm, sam);
  const json slow = study(sam, of_ladder("plan", part));
  EXPECT_EQ(slow["state"], "failed");
  EXPECT_THAT(slow["message"].get<std::string>(), HasSubstr("took too long"));
  const json large = study(sam, of_ladder("check", part));
  EXPECT_EQ(large["state"], "failed") << large.dump();
  for (const auto& entry : fs::recursive_directory_iterator(farm.root + "/studies")) {
    if (entry.is_regular_file()) EXPECT_LE(entry.file_size(), 1U << 20) << entry.path();
  }
  const json failed = study(sam, of_ladder("plate", part));
  EXPECT_EQ(failed["state"], "failed");
  EXPECT_EQ(failed["exit_code"], 7);
}

// --- resins and printers ------------------------------------------------------------------------

/// A database of the test's own, for this process and its children.
class LabFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    database_ = farm_.root + "/db";
    fs::create_directories(database_);
    ::setenv("SLICECORR_DB", database_.c_str(), 1);
  }
  void TearDown() override { ::unsetenv("SLICECORR_DB"); }
  Farm farm_;
  std::string database_;
};

TEST_F(LabFiles, AResinFromATable) {
  const Served served(farm_, with_accounts());
  auto sam = client_of(served, kSubmit), pia = client_of(served, kOperate);
  // Heights of Jacobs' law, h ln(D/Dc) with h = 200 um and Dc = 10 mJ/cm².
  std::string csv = "dose_mj_cm2,cured_height_um\n";
  for (const double dose : {15.0, 20.0, 30.0, 50.0, 80.0, 120.0}) {
    csv += fmt::format("{},{:.6f}\n", dose, 200 * std::log(dose / 10));
  }
  json request = {{"kind", "fit"},
                  {"data", {upload(sam, "heights.csv", csv)}},
                  {"model", "jacobs"},
                  {"name", "test-resin"}};
  const json s = study(sam, request);
  ASSERT_EQ(s["state"], "done") << s.dump();
  const json fit = json::parse(file_of(sam, s, "fit.json"));
  EXPECT_NEAR(fit["parameters"]["h_um"]["value"].get<double>(), 200, 1e-3);
  EXPECT_NEAR(fit["parameters"]["dc_mj_cm2"]["value"].get<double>(), 10, 1e-4);
  EXPECT_THAT(file_of(sam, s, "fit.svg"), HasSubstr("<svg"));
  EXPECT_EQ(status_of(post(sam, "/api/v1/resins", {{"study", s["study"]}})), 403);
  auto added = post(pia, "/api/v1/resins", {{"study", s["study"]}});
  ASSERT_EQ(status_of(added), 201) << added->body;
  EXPECT_TRUE(fs::exists(database_ + "/test-resin.toml") ||
              fs::exists(database_ + "/resins/test-resin.toml"));
  bool found = false;
  for (const json& resin : body_of(sam.Get("/api/v1/resins"))) {
    found = found || resin["name"] == "test-resin";
  }
  EXPECT_TRUE(found);
  EXPECT_THAT(sam.Get("/api/v1/resins/test-resin/curve.svg")->body, HasSubstr("<svg"));
  // A second one of the name needs to be wanted.
  EXPECT_EQ(status_of(post(pia, "/api/v1/resins", {{"study", s["study"]}})), 400);
  EXPECT_EQ(status_of(post(pia, "/api/v1/resins", {{"study", s["study"]}, {"replace", true}})),
            201);
  for (const char* bad : {"no-such-resin", "..%2fx", "-o", "x.toml"}) {
    EXPECT_EQ(status_of(sam.Get((std::string("/api/v1/resins/") + bad + "/curve.svg").c_str())),
              std::string(bad).find("..") == 0 ? 404 : 400)
        << bad;
  }
  // Tables that say nothing.
  request["data"] = {upload(sam, "empty.csv", "dose_mj_cm2,cured_height_um\n1,2\n")};
  const json few = study(sam, request);
  EXPECT_EQ(few["state"], "failed");
  EXPECT_FALSE(few["message"].get<std::string>().empty());
  request["data"] = {upload(sam, "part.stl", "solid")};
  EXPECT_EQ(status_of(post(sam, "/api/v1/studies", request)), 400);
}

TEST_F(LabFiles, APrinterByAForm) {
  const Served served(farm_, with_accounts());
  auto pia = client_of(served, kOperate);
  const json printer = {{"name", "test-printer"},
                        {"width_px", 1920},
                        {"height_px", 1080},
                        {"pixel_um", 50},
                        {"readings", {{0, 0.1}, {128, 9}, {255, 30}}},
                        {"max_speed_mm_h", 900}};
  auto added = post(pia, "/api/v1/printers", printer);
  ASSERT_EQ(status_of(added), 201) << added->body;
  json found;
  for (const json& p : body_of(pia.Get("/api/v1/printers"))) {
    if (p["name"] == "test-printer") found = p;
  }
  EXPECT_EQ(found["width_px"], 1920);
  EXPECT_EQ(found["wavelength_nm"], 405.0);
  EXPECT_EQ(found["calibration"], (json{{0.0, 0.1}, {128.0, 9.0}, {255.0, 30.0}}));
  EXPECT_EQ(found["max_speed_mm_h"], 900.0);
  for (const json& bad : std::vector<json>{{{"name", "Test Printer"}},
                                           {{"name", "../up"}},
                                           {{"name", "a\nb"}},
                                           {{"width_px", "1920"}},
                                           {{"width_px", 0}},
                                           {{"pixel_um", nullptr}},
                                           {{"readings", {{0, 0.1}}}},
                                           {{"readings", {{0, 5}, {255, 1}}}},
                                           {{"readings", "0 0.1"}},
                                           {{"explode", 1}}}) {
    json changed = printer;
    changed["name"] = "second-printer";
    changed.update(bad);
    const auto answer = post(pia, "/api/v1/printers", changed);
    EXPECT_EQ(status_of(answer), 400) << bad.dump() << answer->body;
  }
  EXPECT_FALSE(fs::exists(database_ + "/second-printer.toml"));
}

// --- machines -----------------------------------------------------------------------------------

TEST(Bridges, AJobIsSentToItsMachine) {
  Farm farm;
  const Filled f = fill(farm);
  ServeOptions options = with_accounts();
  options.children.programs = scripts(
      farm,
      {{"printbridge",
        "if [ $1 = status ]; then echo '{\"running\": false, \"phase\": \"done\"}'; exit 0; fi\n"
        "echo \"$@\" >> " +
            farm.root +
            "/printed\n"
            "case \"$*\" in *--dry-run*) exit 0;; *--machine-is-clear*) echo $$ > " +
            farm.root +
            "/pid; sleep 600;; esac\n"
            "echo 'printbridge: the door is open' >&2; exit 4\n"}});
  test::write_file(farm.root + "/bridges.toml",
                   "[[bridge]]\nname = \"left\"\nprinter = \"dual-wavelength-dlp\"\noptions = "
                   "[\"--sink\", \"null\"]\npage = \"http://127.0.0.1:8421/\"\n[[bridge]]\nname = "
                   "\"other\"\nprinter = \"ember\"\n");
  const Served served(farm, options);
  auto pia = client_of(served, kOperate);
  json list = body_of(pia.Get("/api/v1/bridges"))["bridges"];
  ASSERT_EQ(list.size(), 2U);
  EXPECT_EQ(list[0]["state"]["phase"], "done");
  const std::string print = fmt::format("/api/v1/jobs/{}/print", f.done[0]);
  auto answer = post(pia, print, {{"bridge", "left"}, {"dry_run", true}});
  ASSERT_EQ(status_of(answer), 202) << answer->body;
  EXPECT_EQ(body_of(answer)["running"], false);
  EXPECT_EQ(bytes_of(farm.root + "/printed"),
            "print " + farm.model().job(f.done[0])->output("uvj") +
                " --printer dual-wavelength-dlp --sink null --dry-run\n");
  // What the machine refuses is told.
  answer = post(pia, print, {{"bridge", "left"}});
  EXPECT_EQ(status_of(answer), 409);
  EXPECT_EQ(message_of(answer), "the door is open");
  EXPECT_EQ(status_of(post(pia, print, {{"bridge", "other"}})), 409);
  EXPECT_EQ(status_of(post(pia, print, {{"bridge", "none"}})), 404);
  EXPECT_EQ(status_of(post(pia, print, {{"bridge", "left"}, {"options", "x"}})), 400);
  EXPECT_EQ(
      status_of(post(pia, fmt::format("/api/v1/jobs/{}/print", f.queued), {{"bridge", "left"}})),
      409);
  // One print at a time.
  answer = post(pia, print, {{"bridge", "left"}, {"machine_is_clear", true}});
  ASSERT_EQ(status_of(answer), 202) << answer->body;
  EXPECT_EQ(body_of(answer)["running"], true);
  EXPECT_EQ(status_of(post(pia, print, {{"bridge", "left"}})), 409);
  list = body_of(pia.Get("/api/v1/bridges"))["bridges"];
  EXPECT_EQ(list[0]["sent"]["running"], true);
  EXPECT_EQ(list[0]["sent"]["by"], "pia");
  // Prints outlive the server; this one is ours to end.
  const int pid = std::stoi(bytes_of(farm.root + "/pid"));
  ASSERT_GT(pid, 1);
  EXPECT_EQ(::kill(-pid, SIGKILL), 0);
}

TEST(Bridges, TheirFileIsReadStrictly) {
  Farm farm;
  const Served served(farm, with_accounts());
  auto pia = client_of(served, kOperate);
  EXPECT_EQ(body_of(pia.Get("/api/v1/bridges"))["bridges"], json::array());
  for (const char* bad :
       {"[bridge]\n", "[[bridge]]\nname = \"x\"\n", "[[bridge]]\nprinter = \"x\"\n", "not toml",
        "[[bridge]]\nname = \"../x\"\nprinter = \"p\"\n",
        "[[bridge]]\nname = \"x\"\nprinter = \"p\"\npage = \"javascript:alert(1)\"\n",
        "[[bridge]]\nname = \"x\"\nprinter = \"p\"\noptions = \"--sink\"\n",
        "[[bridge]]\nname = \"x\"\nprinter = \"p\"\ncommand = \"sh\"\n"}) {
    test::write_file(farm.root + "/bridges.toml", bad);
    EXPECT_EQ(status_of(pia.Get("/api/v1/bridges")), 503) << bad;
  }
}

}  // namespace
}  // namespace slicecorr::farm
