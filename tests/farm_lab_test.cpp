// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a lab does over HTTP beside jobs and studies: accounts, resins, printers, machines.
#include "farm_lab.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "serve/routes.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/settings.hpp"
#include "submit/fields.hpp"

namespace slicecorr::farm {
namespace {

using namespace test;
using ::testing::HasSubstr;
using ::testing::Not;

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
  EXPECT_EQ(served_description["paths"], description()["paths"]);
  follow(served_description, served_description);
  // Keys are those of jobs files, each with what it is; those of studies the settings that they take.
  const json& schemas = served_description["components"]["schemas"];
  EXPECT_EQ(schemas.dump().find("x-keys"), std::string::npos);
  const json& job = schemas["JobKeys"]["properties"];
  EXPECT_EQ(job.size(), detail::field_names().size());
  for (const std::string& name : detail::field_names()) {
    ASSERT_TRUE(job.contains(name)) << name;
    EXPECT_FALSE(job[name]["description"].get<std::string>().empty()) << name;
  }
  for (const Setting& s : settings()) {
    if (s.said_by != SaidBy::all) continue;
    const std::string name(s.name);
    ASSERT_TRUE(job.contains(name)) << name;
    EXPECT_EQ(job[name]["x-group"], s.group);
    for (const std::string study : {"PlanStudy", "CheckStudy"}) {
      EXPECT_TRUE(schemas[study]["properties"].contains(name)) << study << " " << name;
    }
  }
  // Layers of different heights are of jobs alone.
  for (const char* key : {"layer_heights_um", "adaptive_um"}) {
    EXPECT_TRUE(job.contains(key) && job[key].contains("x-group")) << key;
    for (const char* study : {"PlateStudy", "PlanStudy", "CheckStudy"}) {
      EXPECT_FALSE(schemas[study]["properties"].contains(key)) << study << " " << key;
    }
  }
  EXPECT_TRUE(schemas["PlateStudy"]["properties"].contains("fit_mm"));
  EXPECT_FALSE(schemas["PlateStudy"]["properties"].contains("speed_mm_h"));
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
       {std::string(), std::string("# none\n"), "root lena " + kLook, std::string("look lena"),
        std::string("look lena short"), "look lena " + kLook + " more",
        "look a " + kLook + "\nlook b " + kLook, "look a " + kLook + "\nsubmit a " + kSubmit}) {
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
  // The same again changes nothing; another of the name needs to be wanted.
  EXPECT_EQ(status_of(post(pia, "/api/v1/resins", {{"study", s["study"]}})), 201);
  request["data"] = {upload(sam, "heights.csv", csv + "200,610\n")};
  const json other = study(sam, request);
  ASSERT_EQ(other["state"], "done") << other.dump();
  EXPECT_EQ(status_of(post(pia, "/api/v1/resins", {{"study", other["study"]}})), 400);
  EXPECT_EQ(status_of(post(pia, "/api/v1/resins", {{"study", other["study"]}, {"replace", true}})),
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
