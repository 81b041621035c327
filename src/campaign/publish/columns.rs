//! The data dictionary: each column of the data set with its unit and its meaning.

use hydroline_core::run::{COMPANIONS, Channel};
use hydroline_rigs::{Dof, Rig};

use super::LOADS;

/// Units of a degree of freedom's speed and way, as names end in them.
pub(super) fn units(dof: Dof) -> (&'static str, &'static str) {
    if dof.index() < 3 {
        ("mps", "m")
    } else {
        ("radps", "rad")
    }
}

/// Meaning of each channel, in their order.
const CHANNELS: [&str; 12] = [
    "position of the CG in the tank frame, x",
    "position of the CG in the tank frame, y",
    "position of the CG in the tank frame, z down, 0 on the floor",
    "roll, Euler angle of ZYX",
    "pitch, Euler angle of ZYX",
    "yaw, Euler angle of ZYX",
    "speed of the CG over ground along body x (forward)",
    "speed of the CG over ground along body y (starboard)",
    "speed of the CG over ground along body z (down)",
    "rate of turn about body x",
    "rate of turn about body y",
    "rate of turn about body z",
];

/// Meaning and unit of the columns of runs.csv that do not name a degree of freedom.
const OF_RUNS: [(&str, &str, &str); 22] = [
    ("run", "", "name of the run"),
    ("file", "", "its table"),
    (
        "kind",
        "",
        "record = measured live, simulate = computed, import = measured by other instruments",
    ),
    ("start_utc", "", "UTC of t_s = 0"),
    (
        "waiting_s",
        "s",
        "from the end of the run before; empty: the first of a day, or not known",
    ),
    ("length_s", "s", "from t_s = 0 to the last row"),
    ("rows", "", "rows of the table"),
    ("rate_hz", "Hz", "rows per second, by the median step"),
    ("gaps", "", "steps longer than three usual ones"),
    ("plan", "", "name of the plan that was commanded"),
    ("repeat", "", "which of how many repeats"),
    (
        "medium",
        "",
        "air, fresh or salt water, where it was stated",
    ),
    (
        "water_temperature_degc",
        "degC",
        "temperature of the water, where it was stated",
    ),
    (
        "water_salinity_gpkg",
        "g/kg",
        "salinity, where it was stated",
    ),
    (
        "ballast_kg",
        "kg",
        "ballast beyond the rig's mass, where it was stated",
    ),
    (
        "least_distance_wall_m",
        "m",
        "least distance of the CG from a wall",
    ),
    (
        "least_distance_floor_m",
        "m",
        "least distance of the CG from the floor",
    ),
    (
        "least_distance_surface_m",
        "m",
        "least distance of the CG from the surface",
    ),
    (
        "measured",
        "",
        "columns of the table that hold measurements",
    ),
    ("operator", "", "who recorded, where it was stated"),
    (
        "free_keys",
        "",
        "further statements: KEY=VALUE, with semicolons between",
    ),
    ("note", "", "what the person at the tank wrote"),
];

/// Unit at the end of a column's name.
fn unit_of(name: &str) -> &'static str {
    match name.rsplit('_').next() {
        Some("m") => "m",
        Some("rad") => "rad",
        Some("mps") => "m/s",
        Some("radps") => "rad/s",
        Some("hz") => "Hz",
        Some("n") => "N",
        Some("nm") => "N m",
        _ => "",
    }
}

/// Meaning of a column of runs.csv.
fn of_runs(name: &str) -> String {
    if let Some((_, _, meaning)) = OF_RUNS.iter().find(|c| c.0 == name) {
        return (*meaning).to_owned();
    }
    let dof = Dof::ALL.into_iter().map(Dof::name);
    let dof = dof.into_iter().find(|d| name.contains(*d)).unwrap_or("");
    match name.split('_').next() {
        Some("speed") => format!("largest size of the speed in {dof}"),
        Some("amplitude") => {
            format!("half of the way between two turns in {dof}; empty: no motion to and fro")
        }
        Some("frequency") => format!("frequency of the motion to and fro in {dof}"),
        Some("largest") => format!("largest size of the load in {dof}, by the thrust curves"),
        _ => String::new(),
    }
}

/// Columns of a run's table: name, unit, meaning.
fn of_table(rig: &Rig) -> Vec<(String, String, String)> {
    let mut all = vec![
        (
            "t_s".to_owned(),
            "s".to_owned(),
            "time since start_utc".to_owned(),
        ),
        (
            "timestamp_ns".to_owned(),
            "ns".to_owned(),
            "the same as UNIX time".to_owned(),
        ),
    ];
    let mut add = |name: &str, unit: &str, meaning: String| {
        all.push((name.to_owned(), unit.to_owned(), meaning));
    };
    for (channel, meaning) in Channel::ALL.into_iter().zip(CHANNELS) {
        add(channel.name(), channel.unit(), meaning.to_owned());
    }
    for channel in Channel::POSES {
        let name = channel.name().replacen('_', "_sd_", 1);
        let meaning = format!(
            "standard deviation of {} as its estimator states it",
            channel.name()
        );
        add(&name, channel.unit(), meaning);
    }
    for name in COMPANIONS {
        add(name, unit_of(name), "measured beside the motion".to_owned());
    }
    for name in LOADS {
        add(
            name,
            unit_of(name),
            "load of all thrusters on the body by the thrust curves: mean until the next row"
                .to_owned(),
        );
    }
    for thruster in &rig.thrusters.thrusters {
        let name = format!("thrust_{}_n", thruster.name);
        add(
            &name,
            "N",
            "thrust commanded: mean until the next row".to_owned(),
        );
    }
    let flags = "before_commands, gap_before, loads_change_in_gap, faults of the camera's frames";
    add("flags", "", flags.to_owned());
    all
}

/// columns.csv: file, column, unit, meaning.
///
/// # Errors
/// Those of the CSV writer.
pub(super) fn text(rows: &[Vec<(String, String)>], rig: &Rig) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(["file", "column", "unit", "meaning"])?;
    for (name, _) in rows.iter().take(1).flatten() {
        let unit = OF_RUNS.iter().find(|c| c.0 == name);
        let unit = unit.map_or_else(|| unit_of(name), |c| c.1);
        writer.write_record(["runs.csv", name.as_str(), unit, of_runs(name).as_str()])?;
    }
    for (name, unit, meaning) in of_table(rig) {
        writer.write_record(["runs/*.csv", name.as_str(), unit.as_str(), meaning.as_str()])?;
    }
    Ok(writer.into_inner().map_err(|e| e.into_error())?)
}
