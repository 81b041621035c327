//! README and guide hold what they state: their commands run as printed, outside a checkout, and print what the page says.
//!
//! A page marks its blocks ([`blocks`]); a session joins by a line of [`sessions`].

mod blocks;
mod links;
mod printed;
mod session;
mod spelling;

use crate::support::alone;
use blocks::{Block, Mark};
use session::{Substitution, page, play};
use std::fmt::Write as _;
use std::path::Path;

/// Longest README \[lines\].
const README_LINES: usize = 150;

/// A page's blocks that run one after the other in one folder.
struct Session {
    page: &'static str,
    name: &'static str,
    /// Takes minutes: `tests/nightly readme` runs it.
    nightly: bool,
    /// Brings what the reader would have by then into the folder; `false`: a program that makes it is not installed.
    bring: fn(&Path) -> bool,
    otherwise: &'static [Substitution],
}

impl Session {
    fn play(&self) {
        let _alone = alone();
        let folder = tempfile::tempdir().unwrap();
        if (self.bring)(folder.path()) {
            play(self.page, self.name, folder.path(), self.otherwise);
        }
    }
}

/// Makes a test of each line, and the list of them.
macro_rules! sessions {
    ($($test:ident $(nightly $why:literal)?: $page:literal $name:literal, $bring:expr, $otherwise:expr;)+) => {
        const SESSIONS: &[Session] = &[$(Session {
            page: $page,
            name: $name,
            nightly: { let why: &[&str] = &[$($why)?]; !why.is_empty() },
            bring: $bring,
            otherwise: &$otherwise,
        }),+];
        $(#[test]
        $(#[ignore = $why])?
        fn $test() {
            let same = |s: &&Session| (s.page, s.name, s.nightly) == ($page, $name, { let why: &[&str] = &[$($why)?]; !why.is_empty() });
            SESSIONS.iter().find(same).unwrap().play();
        })+
    };
}

sessions! {
    the_worked_example_prints_what_readme_says: "README.md" "example", nothing, [];
    the_tank_session_runs_on_the_simulator_and_prints_what_readme_says: "README.md" "tank", bring_readings, NO_TIME;
    the_tank_session_runs_as_printed nightly "records in real time as README prints it: three minutes":
        "README.md" "tank", bring_readings, [NO_HANDS];
    the_demo_prints_what_the_guide_says nightly "records in real time: a minute and a half":
        "src/guide/introduction.md" "demo", nothing, [];
    the_tank_day_runs_on_the_simulator nightly "half a minute of processor time: the tank session, which runs every day, takes the same way":
        "src/guide/tank-day.md" "day", bring_readings_and_exposures, DAY;
    plans_are_designed_as_the_tank_day_says nightly "designs for six degrees of freedom: minutes":
        "src/guide/tank-day.md" "design", bring_a_rig, [];
    the_series_until_it_is_decided_runs nightly "records in real time until it is decided: minutes":
        "src/guide/tank-day.md" "decided", bring_a_rig_and_a_tank, UNASKED;
    the_board_is_made_shown_and_calibrated: "src/guide/calibration.md" "board", bring_a_rig, BOARD;
    the_simulated_camera_leaves_light_as_it_is: "src/guide/cameras.md" "exposures", nothing, [];
    the_camera_s_response_is_measured: "src/guide/cameras.md" "response", bring_exposures, [];
    images_of_others_are_read: "src/guide/cameras.md" "images", bring_images, [];
    runs_become_coefficients nightly "half a minute of processor time":
        "src/guide/identify.md" "poses", bring_runs, [];
    the_roll_decay_is_diagnosed nightly "diagnoses a long recording twice: minutes":
        "src/guide/diagnose.md" "roll", bring_the_roll_decay, [];
    logs_of_others_become_verdicts: "src/guide/import.md" "foreign", has_python, FOREIGN;
    logs_of_two_days_are_compared: "src/guide/campaign.md" "campaign", nothing, [];
    sealed_cases_are_proved nightly "nine cases, twenty minutes together":
        "src/guide/validation.md" "prove", nothing, FEW;
    finished_logs_are_shown: "src/guide/view.md" "look", nothing, [ENDED];
    two_rigs_are_compared: "src/guide/view.md" "compare", nothing, [];
    the_service_s_files_are_installed: "src/guide/service.md" "install", bring_a_rig_and_a_calibration, INTO_A_FOLDER;
}

/// A person looks, and ends it.
const NO_HANDS: Substitution = Substitution {
    from: "hydroline aim --rig my-vehicle.toml",
    to: "hydroline aim --rig my-vehicle.toml --for 1s",
    said: "Ctrl-C ends it",
};

/// The same of a page.
const ENDED: Substitution = Substitution {
    from: "hydroline view",
    to: "timeout --preserve-status 3 hydroline view",
    said: "Ctrl-C ends it",
};

/// The rig that `rig new` wrote, of fewer frames.
const FEWER_FRAMES: &str = "hydroline rig new --out my-vehicle.toml && sed -i 's/^rate_fps = 25.0/rate_fps = 5.0/' my-vehicle.toml && grep -q '^rate_fps = 5.0' my-vehicle.toml";

/// A recording in real time becomes a rendering that does not wait, of fewer frames; `replay` is given the calibration that
/// the log would carry.
const NO_TIME: [Substitution; 4] = [
    NO_HANDS,
    Substitution {
        from: "hydroline rig new --out my-vehicle.toml",
        to: FEWER_FRAMES,
        said: "a smaller `rate_fps` in the rig file has less to render",
    },
    Substitution {
        from: "hydroline record --rig my-vehicle.toml --calibration board.calibration.toml",
        to: "hydroline simulate --rig my-vehicle.toml",
        said: "`simulate` in place of `record` does not wait for the clock",
    },
    Substitution {
        from: "hydroline replay",
        to: "hydroline replay --calibration board.calibration.toml",
        said: "its log carries no calibration: give `--calibration` to `replay`",
    },
];

/// The same of the tank day's words.
const DAY: [Substitution; 5] = [
    Substitution {
        from: "hydroline aim    --rig my-vehicle.toml",
        to: "hydroline aim --rig my-vehicle.toml --for 1s",
        said: "until Ctrl-C",
    },
    Substitution {
        from: "hydroline rig new --out my-vehicle.toml",
        to: FEWER_FRAMES,
        said: "A smaller `rate_fps` in the rig file has less to render",
    },
    Substitution {
        from: "hydroline record --rig my-vehicle.toml --calibration board.calibration.toml",
        to: "hydroline simulate --rig my-vehicle.toml",
        said: "`simulate` in place of `record --calibration`",
    },
    Substitution {
        from: "hydroline record --rig my-vehicle.toml --plan reversals --live",
        to: "hydroline simulate --rig my-vehicle.toml --plan reversals --live 127.0.0.1:0",
        said: "`--live` is there for `aim`, `record`, `simulate` and `replay`; `--live 127.0.0.1:0` takes any port that is free",
    },
    Substitution {
        from: "hydroline replay",
        to: "hydroline replay --calibration board.calibration.toml",
        said: "Its log carries no calibration: give `--calibration` to `replay`",
    },
];

/// Nobody presses Enter, and the simulated tank hides something.
const UNASKED: [Substitution; 2] = [
    Substitution {
        from: "--next",
        to: "--next --tank tank.toml --dof surge --yes",
        said: "On the simulator, `--tank` names the rig whose vehicle and `[[physics]]` the tank has",
    },
    Substitution {
        from: "--until-decided",
        to: "--until-decided --tank tank.toml --dof surge --yes",
        said: "`--yes` starts what is proposed",
    },
];

const BOARD: [Substitution; 1] = [Substitution {
    from: "hydroline record --rig my-vehicle.toml --plan surge-4n --calibration board.calibration.toml",
    to: "hydroline simulate --rig my-vehicle.toml --plan surge-4n",
    said: "`simulate` in place of `record` renders the plan's run without waiting for the clock; it takes no `--calibration`",
}];

/// The repository is elsewhere, and the thrusters' names are written by `sed`.
const FOREIGN: [Substitution; 2] = [
    Substitution {
        from: "python3 tests/",
        to: "\"${HYDROLINE_PYTHON:-python3}\" \"$HYDROLINE_REPOSITORY\"/tests/",
        said: "in a clone of the repository",
    },
    Substitution {
        from: "hydroline import flight.bin --map flight.toml --rig",
        to: "sed -i '/^# \\[\\[command/,$ s/^# //' flight.toml
for name in h_fore_stbd h_fore_port h_aft_stbd h_aft_port; do sed -i \"0,/NAME IN THE RIG/ s//$name/\" flight.toml; done
hydroline import flight.bin --map flight.toml --rig",
        said: "write the thrusters' names into the map",
    },
];

/// One case of each.
const FEW: [Substitution; 8] = [
    Substitution {
        from: "hydroline prove      ",
        to: "hydroline prove --cases 1 ",
        said: FEWER,
    },
    Substitution {
        from: "--cases 460 --json",
        to: "--cases 1 --json",
        said: FEWER,
    },
    Substitution {
        from: "--cases 460 --keep",
        to: "--cases 1 --keep",
        said: FEWER,
    },
    Substitution {
        from: "--cases 8",
        to: "--cases 1",
        said: FEWER,
    },
    Substitution {
        from: "--images 90",
        to: "--images 1",
        said: FEWER,
    },
    Substitution {
        from: "--coupled 24",
        to: "--coupled 1",
        said: FEWER,
    },
    Substitution {
        from: "--held-out 80",
        to: "--held-out 1",
        said: FEWER,
    },
    Substitution {
        from: "--invariance 20",
        to: "--invariance 1",
        said: FEWER,
    },
];
const FEWER: &str = "any of these numbers may be smaller, down to 1";

const INTO_A_FOLDER: [Substitution; 4] = [
    Substitution {
        from: " /usr/",
        to: " package/usr/",
        said: FOLDER,
    },
    Substitution {
        from: " /etc/",
        to: " package/etc/",
        said: FOLDER,
    },
    Substitution {
        from: "target/release/hydroline",
        to: "\"$(type -P hydroline)\"",
        said: "a clone in which the program is built",
    },
    Substitution {
        from: "src/daemon",
        to: "\"$HYDROLINE_REPOSITORY\"/src/daemon",
        said: "from a clone",
    },
];
const FOLDER: &str = "a package puts its own folder in front of `/usr` and `/etc`";

/// Runs commands that the reader ran before.
fn before(folder: &Path, commands: &str) -> bool {
    session::run(commands, folder, "what the reader has by then");
    true
}

fn nothing(_: &Path) -> bool {
    true
}

fn has_python(_: &Path) -> bool {
    crate::inputs::python(&["numpy", "rosbags"]).is_some()
}

fn bring_a_rig(folder: &Path) -> bool {
    before(folder, FEWER_FRAMES)
}

fn bring_a_rig_and_a_tank(folder: &Path) -> bool {
    before(
        folder,
        &format!(
            "{FEWER_FRAMES}\n{{ cat my-vehicle.toml; printf '\\n[[physics]]\\neffect = \"thruster_lag\"\\nlag_s = 0.25\\n'; }} > tank.toml"
        ),
    )
}

fn bring_a_rig_and_a_calibration(folder: &Path) -> bool {
    let calibration = session::root().join("tests/data/sample/calibration.toml");
    std::fs::copy(calibration, folder.join("board.calibration.toml")).unwrap();
    before(folder, "hydroline rig new --out my.toml")
}

/// Logs at six exposure times, as the chapter on cameras makes them.
fn make_exposures(folder: &Path) -> bool {
    let cameras = "src/guide/cameras.md";
    let commands = session::commands(cameras, "exposures").concat();
    // Fifteen frames each will do here.
    let short = "name = \"short\"\n[[step]]\nfor_s = 3.0\nwrench = {}\n";
    std::fs::write(folder.join("short.toml"), short).unwrap();
    before(
        folder,
        &commands.replace("--plan still", "--plan short.toml"),
    )
}

fn bring_readings_and_exposures(folder: &Path) -> bool {
    bring_readings(folder) && make_exposures(folder)
}

/// Logs and folders of images at several exposure times.
fn bring_exposures(folder: &Path) -> bool {
    bring_a_rig(folder)
        && make_exposures(folder)
        && before(
            folder,
            "for of in 2:a 4:b 8:c 16:d; do hydroline export e${of%:*}.mcap --frames-only --out ${of#*:}/; done
sed 's/^peak = 200/peak = 1/; s/^rate_fps = 25.0/rate_fps = 5.0/' scene.toml > dark.toml
hydroline simulate --rig dark.toml --plan short.toml --out dark.mcap
hydroline export dark.mcap --frames-only --out dark/",
        )
}

/// A folder of images that count, and a bag of ROS 2 with one image topic of several.
fn bring_images(folder: &Path) -> bool {
    let made = bring_a_rig(folder)
        && before(
            folder,
            "hydroline simulate --rig my-vehicle.toml --plan reversals --out run.mcap
hydroline export run.mcap --frames-only --out named/
mkdir frames; n=0; for image in named/*.png; do n=$((n + 1)); mv $image frames/img$n.png; done",
        );
    let frames: Vec<image::GrayImage> = (1..=5)
        .map(|n| folder.join(format!("frames/img{n}.png")))
        .map(|path| image::open(path).unwrap().into_luma8())
        .collect();
    crate::formats::ros_bag(
        &folder.join("bag.mcap"),
        &["/camera/image_raw", "/front/image_raw"],
        &frames,
    );
    made
}

/// The four runs of a tank day, and one of the plan that is predicted.
fn bring_runs(folder: &Path) -> bool {
    bring_a_rig(folder)
        && before(
            folder,
            "sed -i 's/^rate_fps = 5.0/rate_fps = 4.0/' my-vehicle.toml
for run in still reversals coast-down two-tone surge-4n; do hydroline simulate --rig my-vehicle.toml --plan $run --out $run.mcap; done
hydroline replay surge-4n.mcap --out surge-4n-motion.mcap",
        )
}

fn bring_the_roll_decay(folder: &Path) -> bool {
    let name = "model_test_21338.csv";
    let table = session::root()
        .join("tests/data/cases/real/roll-decay")
        .join(name);
    std::fs::copy(table, folder.join(name)).is_ok()
}

/// Load-cell readings of a bollard pull, as a person would bring them: two sweeps over the curve of the rig that `rig new`
/// writes, each reading off by up to 0.1 N.
fn bring_readings(folder: &Path) -> bool {
    let template = page("rigs/template.toml");
    let curve: Vec<(f64, f64)> = template
        .lines()
        .skip_while(|l| !l.starts_with("curve = ["))
        .filter_map(|l| l.trim().strip_prefix('[')?.strip_suffix("],"))
        .filter_map(|pair| pair.split_once(", "))
        .map_while(|(us, n)| Some((us.parse().ok()?, n.parse().ok()?)))
        .collect();
    assert!(curve.len() > 8, "rigs/template.toml: no curve found");
    let mut table = String::from("pulse_us,thrust_n\n");
    for (k, (pulse_us, thrust_n)) in curve.iter().chain(&curve).enumerate() {
        let off_n = 0.1 * ((k * 7 % 11) as f64 / 5.0 - 1.0);
        writeln!(table, "{pulse_us},{:.2}", thrust_n + off_n).unwrap();
    }
    std::fs::write(folder.join("pull.csv"), table).is_ok()
}

/// Every page: README and the chapters.
fn pages() -> Vec<String> {
    let mut pages: Vec<String> = ["src/guide", "src/guide/theory", "src/guide/reference"]
        .into_iter()
        .flat_map(|folder| {
            let all = std::fs::read_dir(session::root().join(folder)).unwrap();
            all.map(move |entry| (folder, entry.unwrap().file_name().into_string().unwrap()))
        })
        .filter(|(_, name)| name.ends_with(".md"))
        .map(|(folder, name)| format!("{folder}/{name}"))
        .collect();
    pages.push("README.md".to_owned());
    pages.sort();
    pages
}

/// Programs of a block said to run in other scripts that none of these names, one sentence each.
fn not_elsewhere(block: &Block, scripts: &str) -> Vec<String> {
    let texts: Vec<String> = scripts
        .split(", ")
        .map(|script| page(script).replace('\n', " "))
        .collect();
    let words: Vec<&str> = texts
        .iter()
        .flat_map(|t| t.split(|c: char| c.is_whitespace() || ";:(),".contains(c)))
        .collect();
    let missing = block.programs().into_iter();
    missing
        .filter(|program| !words.contains(program))
        .map(|program| format!("`{program}` stands in none of {scripts}"))
        .collect()
}

#[test]
fn every_command_block_is_run_or_says_where() {
    let (mut here, mut nightly, mut elsewhere, mut all) = (0, 0, 0, 0);
    let mut wrong = Vec::new();
    for name in pages() {
        let text = page(&name);
        for line in blocks::indented_commands(&text) {
            wrong.push(format!(
                "{name}:{line}: commands without a fence: put them into one of ```sh"
            ));
        }
        for block in blocks::blocks(&text, &name).unwrap() {
            // The reference spells commands as the program itself prints them: generated, and nothing to run.
            if name.starts_with("src/guide/reference/") {
                continue;
            }
            let at = format!("{name}:{}", block.line);
            all += usize::from(block.is_commands());
            match &block.mark {
                Some((session, Mark::Run)) => {
                    let plays: Vec<&Session> = SESSIONS
                        .iter()
                        .filter(|s| s.page == name && s.name == session)
                        .collect();
                    if !block.is_commands() || plays.is_empty() {
                        wrong.push(format!("{at}: no test plays the session '{session}' (sessions! in {})", file!()));
                    } else if plays.iter().all(|s| s.nightly) {
                        nightly += 1;
                    } else {
                        here += 1;
                    }
                }
                Some((scripts, Mark::Elsewhere)) => {
                    elsewhere += 1;
                    let bad = not_elsewhere(&block, scripts);
                    wrong.extend(bad.iter().map(|words| format!("{at}: {words}")));
                }
                _ if block.is_commands() => wrong.push(format!(
                    "{at}: commands that nothing runs: write <!-- run: SESSION --> above the fence (or where they are run: <!-- elsewhere: SCRIPT -->)"
                )),
                _ => {}
            }
        }
    }
    println!("blocks run here {here}, nightly {nightly}, elsewhere {elsewhere} of {all}");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn readme_stays_short() {
    let lines = page("README.md").lines().count();
    assert!(
        lines <= README_LINES,
        "README.md has {lines} lines, allowed are {README_LINES}: long explanations and tables belong to src/guide"
    );
}

#[test]
fn every_command_on_the_pages_is_one_that_help_knows() {
    let mut wrong = Vec::new();
    for name in pages() {
        let calls = spelling::calls(&page(&name), &name).unwrap();
        wrong.extend(
            spelling::misspelt(&calls)
                .iter()
                .map(|w| format!("{name}: {w}")),
        );
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_link_leads_somewhere() {
    let wrong: Vec<String> = pages()
        .iter()
        .flat_map(|name| links::broken(name, &page(name)))
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_chapter_stands_in_the_summary() {
    let summary = page("src/guide/SUMMARY.md");
    for name in pages() {
        if let Some(chapter) = name.strip_prefix("src/guide/")
            && chapter != "SUMMARY.md"
        {
            assert!(
                summary.contains(&format!("({chapter})")),
                "{chapter} is in no line of src/guide/SUMMARY.md"
            );
        }
    }
}

#[test]
fn every_dependency_has_its_line_in_the_guide() {
    let table = page("src/guide/dependencies.md");
    let named: Vec<&str> = table
        .lines()
        .filter_map(|l| l.strip_prefix("| ")?.split(" | ").next())
        .flat_map(|names| names.trim_end_matches(" (tests)").split(", "))
        .collect();
    let manifest: toml::Table = toml::from_str(&page("Cargo.toml")).unwrap();
    let dependencies = manifest["workspace"]["dependencies"].as_table().unwrap();
    let missing: Vec<&String> = dependencies
        .keys()
        .filter(|d| !d.starts_with("hydroline-") && !named.contains(&d.as_str()))
        .collect();
    assert!(
        missing.is_empty(),
        "no line in src/guide/dependencies.md says what these are for: {missing:?}"
    );
}
