// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The program: its command line, exit status, and one-line error messages.
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <exception>
#include <functional>
#include <new>
#include <string>
#include <string_view>

#include "io/file/text.h"
#include "soilvdb/io/error.h"
#include "soilvdb/version.h"
#include "tools/app/child.h"
#include "tools/app/commands.h"
#include "tools/app/usage.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

constexpr double kLeastVoxel_m = 1e-4, kMostVoxel_m = 100;  // as in a scenario
constexpr std::int64_t kLeastMemory_mb = 16, kMostMemory_mb = 10'000'000;
enum ExitStatus { kDone = 0, kFailed = 1, kWrongInput = 2 };

int complain(ExitStatus status, std::string message) {
  say(std::move(message));
  return status;
}

/// Requires a number in [low, high]; as a transform() it also rewrites the text as a plain number.
CLI::Validator number_between(double low, double high, bool whole, const std::string& meaning) {
  return CLI::Validator(
      [=](std::string& text) {
        const auto value = io::parse_number(text);
        if (!value || !(*value >= low && *value <= high) || (whole && *value != std::floor(*value)))
          return fmt::format("'{}' is not {}", io::printable(text), meaning);
        if (whole) text = fmt::format("{:.0f}", *value);  // 1e3 is 1000
        return std::string();
      },
      "");
}

/// The first signal requests a stop; another one more than a second later ends the program at once.
/// Senders may signal both the process and its group, so one request can arrive twice.
void on_stop(int signal) {
  static volatile std::sig_atomic_t asked_s = 0;
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  const auto now_s = static_cast<std::sig_atomic_t>(now.tv_sec);
  if (!stop_requested) {
    asked_s = now_s;
    stop_requested = true;
  } else if (now_s > asked_s + 1) {
    std::signal(signal, SIG_DFL);
    std::raise(signal);
  }
}

/// The command line, and the options of all commands.
class CommandLine {
 public:
  CommandLine() {
    app_.require_subcommand(1);
    app_.set_version_flag("--version", "soilvdb " SOILVDB_VERSION);
    app_.footer(
        "Exit status: 0 done; 2 the input or the command line is wrong, nothing was "
        "written; 1 anything else.");
    add_run();
    add_resume();
    add_serve();
    add_verify();
    add_info();
    add_export();
    add_diff();
  }

  int main(int argc, char** argv) {
    if (argc > 1 && argv[1][0] != '-' && !has_command(app_, argv[1]))
      return complain(kWrongInput, unknown_command(app_, argv[1]));
    try {
      app_.parse(argc, argv);
    } catch (const CLI::Success& e) {
      app_.exit(e);  // prints help or version
      return kDone;
    } catch (const CLI::ParseError& e) {
      return complain(kWrongInput, explain(app_, e));
    }
    std::signal(SIGXFSZ, SIG_IGN);  // makes an exceeded quota a failed write
    command_();
    return kDone;
  }

 private:
  /// @param kind of its value, for the help
  static CLI::Option* add(CLI::App* sub, const char* name, auto& value, const char* kind,
                          const std::string& help) {
    return sub->add_option(name, value, help)->type_name(kind);
  }
  /// @param otherwise the default, in words
  static void add_memory(CLI::App* sub, std::optional<std::int64_t>& mb, const char* otherwise) {
    add(sub, "--memory", mb, "MB",
        fmt::format(
            "largest memory of the ground, MB, 16 or more; ground that was unused for longest "
            "goes to an unnamed file in the run's folder. The program needs 100 MB more, and up "
            "to 11 kB per chunk of 8 x 8 x 8 voxels while it writes a snapshot. Default: {}",
            otherwise))
        ->transform(number_between(
            kLeastMemory_mb, kMostMemory_mb, true,
            fmt::format("a whole number of MB from {} to {}", kLeastMemory_mb, kMostMemory_mb)));
  }

  /// Runs a command that stops at a signal and keeps its results.
  void stoppable(const std::function<void()>& command) {
    command_ = [command] {
      stop_on_signals();
      command();
    };
  }

  void add_run() {
    CLI::App* sub = app_.add_subcommand("run", "dig a scenario");
    sub->add_option("SCENARIO", run_.scenario, "scenario file (YAML)")->required();
    add(sub, "--out", run_.out, "DIR", "folder to write to; default: out/<scenario name>");
    add(sub, "--voxel", run_.voxel_size_m, "M", "voxel size instead of the scenario's, m")
        ->check(number_between(
            kLeastVoxel_m, kMostVoxel_m, false,
            fmt::format("a voxel size from {} to {} m", kLeastVoxel_m, kMostVoxel_m)));
    add(sub, "--threads", run_.threads, "N", "threads; default: one per core")
        ->transform(number_between(1, 1024, true, "a whole number from 1 to 1024"));
    add(sub, "--updates", run_.updates, "N",
        "updates of each machine, even in time over its motion; default: one per row "
        "of the motion")
        ->transform(number_between(1, 1e8, true, "a whole number from 1 to 100000000"));
    add_memory(sub, run_.memory_mb, "no limit");
    sub->add_flag("--no-mesh", no_mesh_, "no mesh, even if the scenario asks for one");
    sub->add_flag("--no-snapshots", no_snapshots_, "no snapshots, not even the last");
    sub->callback([this] {
      run_.mesh = !no_mesh_;
      run_.snapshots = !no_snapshots_;
      stoppable([this] { run(run_); });
    });
  }

  void add_resume() {
    CLI::App* sub = app_.add_subcommand("resume", "resume an interrupted run");
    sub->add_option("DIR", resume_.folder, "folder the run writes to")->required();
    add_memory(sub, resume_.memory_mb, "as for the run");
    sub->callback([this] { stoppable([this] { resume(resume_); }); });
  }

  void add_serve() {
    CLI::App* sub = app_.add_subcommand("serve", "a live site: fed by streams, seen in a browser");
    sub->add_option("SCENARIO|DIR", serve_.scenario,
                    "scenario file (YAML), or the folder of a run or recording to look at")
        ->required();
    add(sub, "--out", serve_.out, "DIR",
        "folder to record to; a recording in it is continued. Default: out/<scenario "
        "name>_live, with --speed a temporary folder");
    add(sub, "--port", serve_.port, "P", "port to listen on, 0 for any that is free; default: 8470")
        ->transform(number_between(0, 65535, true, "a whole number from 0 to 65535"));
    add(sub, "--listen", serve_.listen, "ADDR",
        "address to listen on; default: 127.0.0.1, for this computer alone");
    add(sub, "--token-file", serve_.token_file, "FILE",
        "file with the secret of those who feed, and look; required with --listen. "
        "Default: the variable SOILVDB_TOKEN");
    add(sub, "--view-token-file", serve_.view_token_file, "FILE",
        "file with the secret of those who only look. Default: the variable "
        "SOILVDB_VIEW_TOKEN");
    add(sub, "--token", serve_.token, "T",
        "the secret itself; other users of the computer can read it");
    add(sub, "--view-token", serve_.view_token, "T", "secret of those who only look");
    sub->add_flag("--public-view", serve_.public_view, "whoever only looks needs no secret");
    add(sub, "--base-path", serve_.base_path, "PATH",
        "path below which a proxy serves it, such as /dig; default: the root");
    add(sub, "--speed", serve_.speed, "X",
        "play the scenario's own motions, at this multiple of their speed")
        ->check(number_between(1e-3, 1e4, false, "a number from 0.001 to 10000"));
    add(sub, "--design", serve_.design, "FILE",
        "design surface to compare the ground with: a raster, or the triangles of a "
        "LandXML (.xml) or DXF; one of several surfaces as FILE#NAME");
    add(sub, "--lines", serve_.lines, "FILE",
        "lines of a design to draw: LandXML (.xml), DXF, GeoPackage, GeoJSON or "
        "Shapefile");
    add(sub, "--drape", serve_.drape, "FILE",
        "orthophoto or map to lay over the ground on the page (GeoTIFF, JPEG, PNG ...)");
    add(sub, "--boundary", serve_.boundary, "FILE",
        "boundary that machines must not leave: a line x,y for each corner");
    sub->add_flag("--stdin", serve_.feed_stdin,
                  "feed lines from standard input, too; answers go to standard output");
    sub->add_flag("--ros", serve_.ros,
                  "exchange messages with nodes of ROS 2: the topics of motions move machines, and "
                  "loads, forces and the ground are published");
    add(sub, "--mqtt", serve_.mqtt, "BROKER",
        "also take lines of feeds from TOPIC/feed/NAME of an MQTT broker: "
        "[mqtts://][USER@]HOST[:PORT][/TOPIC]. Default: port 1883, with mqtts:// "
        "(TLS) 8883; topic soilvdb/<scenario name>");
    add(sub, "--mqtt-password-file", serve_.mqtt_password_file, "FILE",
        "file with USER's password. Default: the variable SOILVDB_MQTT_PASSWORD");
    sub->callback([this] { command_ = [this] { serve(serve_); }; });
  }

  void add_verify() {
    CLI::App* sub = app_.add_subcommand("verify", "check whether a run or file is intact");
    sub->add_option("DIR|FILE", verify_, "folder of a run, or a snapshot or journal")->required();
    sub->callback([this] { command_ = [this] { verify(verify_); }; });
  }

  void add_info() {
    CLI::App* sub = app_.add_subcommand("info", "describe a file");
    sub->add_option("FILE", info_, ".vdb, raster, LandXML, DXF or scenario")->required();
    sub->callback([this] { command_ = [this] { info(info_); }; });
  }

  void add_export() {
    CLI::App* sub = app_.add_subcommand("export", "write a snapshot for other programs");
    sub->add_option("FILE", export_.file, "snapshot (.vdb)")->required();
    add(sub, "--to", export_.to, "OUT",
        "file to write: .ply .obj .stl .glb mesh, .tif surface and change, .xml "
        "LandXML surface, .png picture, .vdb closed level set")
        ->required();
    add(sub, "--region", export_.region, "XMIN,YMIN,XMAX,YMAX", "only this part of the site, m");
    add(sub, "--view", export_.view, "plan|perspective", "of a .png picture; default: plan")
        ->check(CLI::Validator(
            [](std::string& text) {
              if (text == "plan" || text == "perspective") return std::string();
              return fmt::format("'{}' is neither plan nor perspective", io::printable(text));
            },
            ""));
    sub->add_flag("--occupancy", export_.occupancy,
                  "a .vdb of the share of soil in each voxel, in place of a level set");
    sub->callback([this] { command_ = [this] { export_file(export_); }; });
  }

  void add_diff() {
    CLI::App* sub = app_.add_subcommand("diff", "cut and fill between two snapshots of a site");
    sub->add_option("A.vdb", diff_.before, "snapshot before")->required();
    sub->add_option("B.vdb", diff_.after, "snapshot after")->required();
    add(sub, "--to", diff_.to, "OUT", "write the change of height: .tif raster or .png picture");
    sub->add_flag("--json", diff_.json, "print the numbers as JSON");
    sub->callback([this] { command_ = [this] { diff(diff_); }; });
  }

  CLI::App app_{"Tracks the ground and the soil in the bucket while excavators dig.", "soilvdb"};
  RunOptions run_;
  bool no_mesh_ = false, no_snapshots_ = false;
  ResumeOptions resume_;
  ServeOptions serve_;
  std::filesystem::path verify_, info_;
  ExportOptions export_;
  DiffOptions diff_;
  std::function<void()> command_;
};

/// Corrects what the program inherits: opened files must not become standard streams, and children
/// must be waited for. GDAL's cache is limited, because its default is 5 % of the memory and
/// heights are kept decoded; a user's own setting holds.
void set_up_process() {
  int descriptor = 0;
  while (descriptor >= 0 && descriptor <= STDERR_FILENO) descriptor = open("/dev/null", O_RDWR);
  close(descriptor);
  std::signal(SIGCHLD, SIG_DFL);
  setenv("GDAL_CACHEMAX", "64", /*overwrite=*/0);
}

int guarded_main(int argc, char** argv) {
  set_up_process();
  try {
    if (argc == 4 && std::string_view(argv[1]) == kInChild) child_main(argv[2], argv[3]);
    const int status = CommandLine().main(argc, argv);
    if (std::fflush(stdout) != 0 || std::ferror(stdout))
      return complain(kFailed, "standard output can't be written to");
    return status;
  } catch (const io::InputError& e) {
    return complain(kWrongInput, e.what());
  } catch (const std::bad_alloc&) {
    return complain(kFailed, "out of memory");
  } catch (const std::exception& e) {
    return complain(kFailed, e.what());
  }
}

}  // namespace

void stop_on_signals() {
  struct sigaction stop {};
  stop.sa_handler = on_stop;
  stop.sa_flags = SA_RESTART;
  sigaddset(&stop.sa_mask, SIGINT);
  sigaddset(&stop.sa_mask, SIGTERM);
  sigaction(SIGINT, &stop, nullptr);
  sigaction(SIGTERM, &stop, nullptr);
}

}  // namespace soilvdb::tools

int main(int argc, char** argv) { return soilvdb::tools::guarded_main(argc, argv); }
