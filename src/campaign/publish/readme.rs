//! README.md of a data set: what it is, how it was measured, how to read it, and what is not known.

use hydroline_report::significant;
use hydroline_rigs::{Dof, Rig};

use super::{About, File, Published};

/// Conditions that ITTC's procedures ask for, with the column that says them and the option of `record` that states it.
const CONDITIONS: [(&str, &str, &str); 4] = [
    (
        "temperature of the water",
        "water.temperature_c",
        "--water-temp",
    ),
    ("salinity of the water", "water.salinity_gpkg", "--salinity"),
    ("who recorded", "operator", "--operator"),
    ("notes of the person at the tank", "note", "--note"),
];

/// A text of others as a cell of a table in Markdown.
fn cell(text: &str) -> String {
    let line = hydroline_core::plain::word(text).replace('|', "\\|");
    line.replace('<', "&lt;")
}

/// A table in Markdown.
fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let mut text = line(head.iter().map(|h| (*h).to_owned()).collect());
    text += &line(vec!["---".to_owned(); head.len()]);
    for row in rows {
        text += &line(row.iter().map(|c| cell(c)).collect());
    }
    text
}

/// The whole text.
pub(super) fn text(runs: &[&Published], rig: &Rig, about: &About, more: &[File]) -> String {
    let stated = |what: &Option<String>| what.clone().unwrap_or_else(|| "not stated".to_owned());
    let mut text = format!(
        "# {}\n\nAuthors: {}  \nLicence: {}  \nReference: {}\n\n",
        cell(&about.title),
        cell(&stated(&about.authors)),
        cell(&stated(&about.licence)),
        cell(&stated(&about.reference)),
    );
    let simulated = runs.iter().filter(|r| r.said("kind") == "simulate").count();
    text += &format!(
        "{} run{} of the vehicle {}: motion in six degrees of freedom beside the loads of its thrusters.",
        runs.len(),
        if runs.len() == 1 { "" } else { "s" },
        rig.name
    );
    match simulated {
        0 => {}
        n if n == runs.len() => text += " **All of them are simulated.**",
        n => text += &format!(" **{n} of them are simulated** (column `kind` of runs.csv)."),
    }
    text += &format!(" Written by {}.\n\n", cell(&about.made_by));
    text += &contents(more);
    text += &list(runs);
    text += FRAMES;
    text += &vehicle(rig);
    text += &conditions(rig, runs);
    text += &reading(runs);
    text += &unknown(runs, about);
    text
}

fn contents(more: &[File]) -> String {
    let mut rows: Vec<Vec<String>> = [
        ("runs.csv", "one row per run: conditions, length, speeds, amplitudes, frequencies, largest loads"),
        ("runs/NAME.csv", "one row per measurement: pose with its standard deviations, rates, loads, thrusts, flags"),
        ("columns.csv", "each column with its unit and its meaning"),
        ("rig.toml", "vehicle, thrusters with their curves, camera, laser, tank as the runs were recorded with them"),
        ("SHA256SUMS", "checksums of all files: `sha256sum -c SHA256SUMS`"),
    ]
    .map(|(name, what)| vec![name.to_owned(), what.to_owned()])
    .into();
    for (name, _) in more {
        let what = match name.as_str() {
            "coefficients.csv" => {
                "hydrodynamic coefficients found from such runs, with their 95 % intervals"
            }
            _ => "",
        };
        rows.push(vec![name.clone(), what.to_owned()]);
    }
    format!("## Files\n\n{}\n", table(&["file", "contents"], &rows))
}

fn list(runs: &[&Published]) -> String {
    let rows: Vec<Vec<String>> = runs
        .iter()
        .map(|run| {
            let fastest = Dof::ALL.into_iter().filter_map(|dof| {
                let speed = run.seen.get(dof.name())?.speed;
                let unit = if dof.index() < 3 { "m/s" } else { "rad/s" };
                Some(format!("{} {} {unit}", dof.name(), significant(speed)))
            });
            vec![
                run.name.clone(),
                run.start_utc(),
                run.said("plan.name").to_owned(),
                significant(run.length_s),
                run.rows.to_string(),
                run.rate_hz.map_or(String::new(), significant),
                fastest.collect::<Vec<_>>().join(", "),
            ]
        })
        .collect();
    let head = [
        "run",
        "start (UTC)",
        "plan",
        "length [s]",
        "rows",
        "rate [Hz]",
        "largest speeds",
    ];
    format!("## Runs\n\n{}\n", table(&head, &rows))
}

const FRAMES: &str = "\
## Frames, signs, units

SI throughout, angles in radians; a column's unit is its ending (`columns.csv`). Tank frame: x, y level, z **down**, 0 on the floor. Body \
frame: x forward, y starboard, z down, origin at the centre of gravity (CG). Attitude: Euler angles ZYX (yaw, pitch, roll). Rates: of the CG, in the body \
frame, over ground. Loads: on the body, along and about the body's axes, from the commanded pulses by the thrust curves in `rig.toml`; between two rows \
their mean, so that load times step is the impulse. An empty cell is \"not known\", never 0.

";

fn vehicle(rig: &Rig) -> String {
    let v = &rig.vehicle;
    let [ix, iy, iz] = v.inertia_kgm2;
    let rows = [
        ("mass", v.mass_kg.to_string(), "kg"),
        (
            "moments of inertia I_x, I_y, I_z",
            format!("{ix}, {iy}, {iz}"),
            "kg m2",
        ),
        (
            "centre of buoyancy from the CG, z down",
            v.r_bz_m.to_string(),
            "m",
        ),
        ("weight less buoyancy", v.net_weight_n.to_string(), "N"),
        (
            "gravitational acceleration",
            v.gravity_mps2.to_string(),
            "m/s2",
        ),
        ("thrusters", rig.thrusters.thrusters.len().to_string(), ""),
    ]
    .map(|(what, value, unit)| vec![what.to_owned(), value, unit.to_owned()]);
    let measured = match &rig.bollard {
        Some(pull) if pull.voltage_v > 0.0 => format!(
            "The thrust curve was measured by a bollard pull at {} V; its covariance is in `rig.toml`.",
            pull.voltage_v
        ),
        Some(_) => "The thrust curve was measured by a bollard pull; its covariance is in `rig.toml`.".to_owned(),
        None => "The thrust curve was not measured by a bollard pull: take its scale as an unknown, some 5 %.".to_owned(),
    };
    let known = match &rig.identified {
        Some(known) => match &known.source {
            Some(source) => format!(
                "Coefficients in `rig.toml` are no result of these runs: {}.",
                cell(source)
            ),
            None => {
                "Coefficients in `rig.toml` were identified; their covariance is in `[identified]`."
                    .to_owned()
            }
        },
        None => "Coefficients in `rig.toml` are starting values, no result.".to_owned(),
    };
    format!(
        "## Vehicle\n\n{}\nThrusters, by position and direction in the body frame:\n\n{}\n{measured} {known}\n\n",
        table(&["particular", "value", "unit"], &rows),
        thrusters(rig)
    )
}

fn thrusters(rig: &Rig) -> String {
    let set = &rig.thrusters;
    let rows: Vec<Vec<String>> = set
        .thrusters
        .iter()
        .map(|t| {
            let (least, most) = t.curve.thrust_range_n(set.min_us, set.max_us);
            let three = |v: [f64; 3]| v.map(|v| v.to_string()).join(", ");
            vec![
                t.name.clone(),
                three(t.position_m),
                three(t.direction),
                format!("{} .. {}", significant(least), significant(most)),
            ]
        })
        .collect();
    table(
        &["thruster", "position [m]", "direction", "thrust [N]"],
        &rows,
    )
}

/// Least of a number over all runs that know it.
fn least(runs: &[&Published], place: usize) -> String {
    let all = runs
        .iter()
        .filter_map(|r| r.least_m.get(place).copied().flatten());
    all.reduce(f64::min)
        .map_or("not known".to_owned(), significant)
}

fn conditions(rig: &Rig, runs: &[&Published]) -> String {
    let tank = rig.tank;
    let c = &rig.camera;
    let length = |[low, high]: [f64; 2]| significant(high - low);
    let rows = [
        (
            "tank: length, width, depth",
            format!(
                "{}, {}, {}",
                length(tank.x_m),
                length(tank.y_m),
                significant(tank.depth_m)
            ),
            "m",
        ),
        ("least distance of the CG from a wall", least(runs, 0), "m"),
        (
            "least distance of the CG from the floor",
            least(runs, 1),
            "m",
        ),
        (
            "least distance of the CG from the surface",
            least(runs, 2),
            "m",
        ),
        (
            "refractive index before the camera",
            tank.n_water.to_string(),
            "",
        ),
        (
            "camera",
            format!(
                "{} x {} at {}",
                c.width_px,
                c.height_px,
                significant(c.rate_fps)
            ),
            "px, Hz",
        ),
    ]
    .map(|(what, value, unit)| vec![what.to_owned(), value, unit.to_owned()]);
    format!(
        "## Conditions and instruments\n\n{}\nWater temperature, salinity, ballast and the waiting time before each run are columns of `runs.csv`; standard deviations of \
the poses are in the tables (`x_sd_m` .. `psi_sd_rad`).\n\n",
        table(&["condition", "value", "unit"], &rows)
    )
}

fn reading(runs: &[&Published]) -> String {
    let name = runs.first().map_or("NAME", |r| r.name.as_str());
    format!(
        "## Reading it\n\n```python\nimport pandas as pd\n\nruns = pd.read_csv(\"runs.csv\")\nrun = pd.read_csv(\"runs/{name}.csv\")\nsurge = run[[\"t_s\", \"x_m\", \"u_mps\", \"surge_n\"]]\n```\n\nWith hydroline: \
`hydroline import runs/{name}.csv --guess` makes a map of the columns, `hydroline identify` finds the coefficients.\n\n"
    )
}

/// What the card does not say, with what would.
fn unknown(runs: &[&Published], about: &About) -> String {
    let mut lines = Vec::new();
    for (what, key, option) in CONDITIONS {
        let without = runs.iter().filter(|r| r.said(key).is_empty()).count();
        if without > 0 {
            lines.push(format!(
                "{what}: not stated for {without} of {} runs (`hydroline record {option}`)",
                runs.len()
            ));
        }
    }
    let unplaced = runs
        .iter()
        .filter(|r| r.least_m.iter().any(Option::is_none))
        .count();
    if unplaced > 0 {
        lines.push(format!(
            "distances to walls, floor or surface: not known of {unplaced} of {} runs (no position in the tank's frame)",
            runs.len()
        ));
    }
    let unloaded = runs.iter().filter(|r| r.largest_load.is_none()).count();
    if unloaded > 0 {
        lines.push(format!(
            "loads: no command in {unloaded} of {} runs",
            runs.len()
        ));
    }
    for (what, value, option) in [
        ("authors", &about.authors, "--authors"),
        ("licence", &about.licence, "--licence"),
        ("reference", &about.reference, "--reference"),
    ] {
        if value.is_none() {
            lines.push(format!("{what}: not stated (`hydroline publish {option}`)"));
        }
    }
    lines.push(
        "turbulence and residual motion of the water, blockage by the tank: not measured"
            .to_owned(),
    );
    let lines: Vec<String> = lines.into_iter().map(|l| format!("- {l}\n")).collect();
    format!("## What is not known\n\n{}", lines.concat())
}
