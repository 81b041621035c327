//! Coefficients as lines of a table, converted; and the table as CSV, LaTeX and text.

use hydroline_report::significant;
use hydroline_rigs::Dof;
use schemars::JsonSchema;
use serde::Serialize;

use super::froude::Scale;
use super::regime::{Range, Regime, ranges, regime};
use super::{Dimension, Fitted, Particulars, Prime, PrimeError, Row};

/// A value with its spread, in one unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct Number {
    /// Estimate.
    pub value: f64,
    /// Standard deviation; `None` = nothing is known of it.
    pub sd: Option<f64>,
    /// Lower end of the 95 % interval.
    pub low: Option<f64>,
    /// Its upper end.
    pub high: Option<f64>,
}

impl Number {
    fn of(row: &Row, factor: f64) -> Number {
        Number {
            value: factor * row.value,
            sd: row.sd.map(|sd| factor * sd),
            low: row.interval.map(|[low, _]| factor * low),
            high: row.interval.map(|[_, high]| factor * high),
        }
    }
}

/// A coefficient.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Line {
    /// Name in rig files and results.
    pub key: &'static str,
    /// Symbol of SNAME.
    pub symbol: &'static str,
    /// SI unit.
    pub unit: &'static str,
    /// As it was found, SI.
    pub dimensional: Number,
    /// In the prime system asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nondimensional: Option<Number>,
    /// At the size asked for, SI.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scaled: Option<Number>,
}

/// Reference quantities of a table.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Reference {
    /// Prime system: I, II or bis; `None` = dimensional only.
    pub system: Option<&'static str>,
    /// Reference length L \[m\].
    pub length_m: Option<f64>,
    /// Reference speed U \[m/s\].
    pub speed_mps: Option<f64>,
    /// Draught T \[m\].
    pub draught_m: Option<f64>,
    /// Mass of the vehicle \[kg\].
    pub mass_kg: Option<f64>,
    /// Density of the water \[kg/m3\].
    pub density_kgpm3: f64,
    /// Its kinematic viscosity \[m2/s\].
    pub viscosity_m2ps: f64,
    /// Gravitational acceleration \[m/s2\].
    pub gravity_mps2: f64,
    /// Length of the other hull over that of this one.
    pub scale: Option<f64>,
}

/// What is to be made of coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Asked {
    /// Prime system, with the hull that gives its units.
    pub prime: Option<Prime>,
    /// Hull; without it no prime system and no regime.
    pub hull: Option<Particulars>,
    /// Size of another hull.
    pub scale: Option<Scale>,
    /// Density of the water \[kg/m3\] where no hull says it; `None` = fresh water.
    pub density_kgpm3: Option<f64>,
    /// Kinematic viscosity \[m2/s\]; `None` = fresh water at 20 °C.
    pub viscosity_m2ps: Option<f64>,
}

/// A whole table.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Table {
    /// What the coefficients were read from.
    pub source: String,
    /// Where the uncertainty comes from when runs of the vehicle did not give it, as the spread of published sets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub basis: Option<String>,
    /// Reference quantities.
    pub reference: Reference,
    /// Coefficients in SNAME order.
    pub coefficients: Vec<Line>,
    /// Regime of each run by DOF.
    pub runs: Vec<Regime>,
    /// Ranges by DOF in which the coefficients were seen.
    pub ranges: Vec<Range>,
    /// What the source does not hold, in words.
    pub missing: Vec<String>,
}

impl Table {
    /// The table of what was fitted.
    ///
    /// # Errors
    /// [`PrimeError`] where the system asked for needs a number that is not there.
    pub fn new(fitted: &Fitted, asked: &Asked) -> Result<Table, PrimeError> {
        let hull = asked.hull.map(|hull| Particulars {
            mass_kg: hull.mass_kg.or(fitted.mass_kg),
            ..hull
        });
        let units = match (asked.prime, &hull) {
            (None, _) => None,
            (Some(prime), Some(hull)) => Some(prime.units(hull)?),
            (Some(prime), None) => {
                return Err(PrimeError::Missing {
                    system: prime.name(),
                    what: "the length L [m]",
                    flag: "--length",
                });
            }
        };
        let line = |row: &Row| {
            let (c, dimension) = (row.coefficient, Dimension::of(row.coefficient));
            Line {
                key: c.key(),
                symbol: c.symbol(),
                unit: c.unit(),
                dimensional: Number::of(row, 1.0),
                nondimensional: units.map(|u| Number::of(row, 1.0 / u.of(dimension))),
                scaled: asked.scale.map(|s| Number::of(row, s.of(dimension))),
            }
        };
        let viscosity_m2ps = asked
            .viscosity_m2ps
            .unwrap_or(super::regime::VISCOSITY_M2PS);
        let standard = Particulars {
            density_kgpm3: asked.density_kgpm3.unwrap_or(super::prime::FRESH_KGPM3),
            gravity_mps2: fitted.gravity_mps2.unwrap_or(super::prime::GRAVITY_MPS2),
            ..Particulars::of_length(1.0)
        };
        let of_water = hull.as_ref().unwrap_or(&standard);
        let mut runs: Vec<Regime> = Vec::new();
        for (run, seen) in &fitted.runs {
            let of = |(dof, seen): &_| regime(run, *dof, seen, of_water, viscosity_m2ps);
            runs.extend(seen.iter().map(of));
        }
        // Speeds, amplitudes and frequencies are the same for any length.
        let ranges = ranges(&runs);
        if hull.is_none() {
            runs.clear();
        }
        let mut missing = fitted.missing.clone();
        if hull.is_none() && !fitted.runs.is_empty() {
            missing
                .push("no Re, Fn and KC: the hull's length is not known; give --length".to_owned());
        }
        if asked.scale.is_some() {
            missing.push("the other size is at the same Froude number: its Reynolds number is another one, and what viscosity does is not scaled".to_owned());
        }
        Ok(Table {
            source: fitted.source.clone(),
            basis: fitted.basis.clone(),
            reference: Reference {
                system: asked.prime.map(Prime::name),
                length_m: hull.map(|h| h.length_m),
                speed_mps: hull.and_then(|h| h.speed_mps),
                draught_m: hull.and_then(|h| h.draught_m),
                mass_kg: hull.and_then(|h| h.mass_kg).or(fitted.mass_kg),
                density_kgpm3: of_water.density_kgpm3,
                viscosity_m2ps,
                gravity_mps2: of_water.gravity_mps2,
                scale: asked.scale.map(|s| s.factor),
            },
            coefficients: fitted.rows.iter().map(line).collect(),
            ranges,
            runs,
            missing,
        })
    }

    /// Mark of the prime system behind symbols; empty without one.
    fn mark(&self) -> &'static str {
        let system = self.reference.system.and_then(Prime::named);
        system.map_or("", Prime::mark)
    }

    /// Rows of numbers under one head, all digits, for another program.
    ///
    /// # Errors
    /// Those of the CSV writer.
    pub fn csv(&self) -> Result<String, csv::Error> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let parts = ["", "sd_", "low_", "high_"];
        let mut head: Vec<String> = vec!["coefficient".into(), "unit".into()];
        let system = self.reference.system.map(str::to_lowercase);
        let columns = [
            Some("si".to_owned()),
            system.map(|s| if s == "bis" { s } else { format!("prime_{s}") }),
            self.reference.scale.map(|_| "scaled_si".to_owned()),
        ];
        for name in columns.iter().flatten() {
            head.extend(parts.iter().map(|p| format!("{p}{name}")));
        }
        writer.write_record(&head)?;
        for line in &self.coefficients {
            let mut cells = vec![line.key.to_owned(), line.unit.to_owned()];
            for number in line.numbers() {
                let all = [Some(number.value), number.sd, number.low, number.high];
                cells.extend(all.map(|v| v.map_or(String::new(), |v| v.to_string())));
            }
            writer.write_record(&cells)?;
        }
        let bytes = writer.into_inner().map_err(|e| e.into_error())?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// A table for a paper: `booktabs`, symbols in mathematics, 95 % intervals.
    pub fn latex(&self) -> String {
        let mark = self.mark();
        let mut columns = vec!["value", "95\\,\\% interval"];
        let (mut head, mut of) = ("ll".to_owned() + "rr", vec!["", "SI"]);
        if self.reference.system.is_some() {
            columns.extend(["value", "95\\,\\% interval"]);
            head += "rr";
            of.push("nondimensional");
        }
        if self.reference.scale.is_some() {
            columns.extend(["value", "95\\,\\% interval"]);
            head += "rr";
            of.push("at the other size, SI");
        }
        let groups: Vec<String> = of[1..]
            .iter()
            .map(|name| format!("\\multicolumn{{2}}{{c}}{{{name}}}"))
            .collect();
        let mut text = format!(
            "% {}\n\\begin{{tabular}}{{{head}}}\n\\toprule\n & & {} \\\\\n & unit & {} \\\\\n\\midrule\n",
            self.caption(),
            groups.join(" & "),
            columns.join(" & ")
        );
        for line in &self.coefficients {
            let cells: Vec<String> = line
                .numbers()
                .map(|n| {
                    let interval = match (n.low, n.high) {
                        (Some(low), Some(high)) => {
                            format!("${}$ to ${}$", power(low), power(high))
                        }
                        _ => "--".to_owned(),
                    };
                    format!("${}$ & {interval}", power(n.value))
                })
                .collect();
            let mark = if self.reference.system.is_some() {
                mark
            } else {
                ""
            };
            text += &format!(
                "${}$ & {} & {} \\\\\n",
                in_mathematics(line.key, mark),
                unit(line.unit),
                cells.join(" & ")
            );
        }
        text + "\\bottomrule\n\\end{tabular}\n"
    }

    /// Reference quantities in one line.
    pub fn caption(&self) -> String {
        let r = &self.reference;
        let mut parts = vec![format!("{}: coefficients", self.source)];
        match r.system {
            Some("bis") => parts.push("bis system".to_owned()),
            Some(system) => parts.push(format!("prime system {system}")),
            None => {}
        }
        let known = [
            ("L", r.length_m, "m"),
            ("U", r.speed_mps, "m/s"),
            ("T", r.draught_m, "m"),
            ("m", r.mass_kg, "kg"),
            ("scale", r.scale, ""),
        ];
        for (name, value, unit) in known {
            if let Some(value) = value {
                parts.push(format!("{name} = {value} {unit}").trim_end().to_owned());
            }
        }
        parts.push(format!("rho = {} kg/m3", r.density_kgpm3));
        parts.push(format!("g = {} m/s2", r.gravity_mps2));
        if let Some(basis) = &self.basis {
            parts.push(format!("intervals: {basis}"));
        }
        parts.join(", ")
    }

    /// A table to read, in columns.
    pub fn text(&self) -> String {
        let mark = self.mark();
        let mut rows: Vec<Vec<String>> = vec![vec![
            "".into(),
            "value".into(),
            "95 % interval".into(),
            "unit".into(),
        ]];
        if let Some(system) = self.reference.system {
            rows[0].extend([format!("{system}: value"), "95 % interval".to_owned()]);
        }
        if let Some(scale) = self.reference.scale {
            rows[0].extend([format!("x {scale}: value"), "95 % interval".to_owned()]);
        }
        for line in &self.coefficients {
            let mut cells = vec![format!("{}{mark}", line.symbol)];
            for (k, number) in line.numbers().enumerate() {
                let ends = number.low.zip(number.high);
                cells.push(significant(number.value));
                cells.push(ends.map_or("-".to_owned(), |(low, high)| {
                    format!("{} .. {}", significant(low), significant(high))
                }));
                if k == 0 {
                    cells.push(line.unit.to_owned());
                }
            }
            rows.push(cells);
        }
        let mut text = format!("{}\n\n{}", self.caption(), columns(&rows));
        let of = |v: Option<f64>| v.map_or("-".to_owned(), significant);
        if !self.ranges.is_empty() {
            let head = [
                "seen in",
                "largest speed of runs",
                "amplitude",
                "frequency [Hz]",
            ];
            let two =
                |ends: [f64; 2]| format!("{} .. {}", significant(ends[0]), significant(ends[1]));
            let mut rows = vec![head.map(String::from).to_vec()];
            for r in &self.ranges {
                let (speed, way) = units_of_motion(r.dof);
                let with = |ends: Option<[f64; 2]>, unit: &str| {
                    ends.map_or("-".to_owned(), |e| {
                        format!("{} {unit}", two(e)).trim_end().to_owned()
                    })
                };
                rows.push(vec![
                    r.dof.to_owned(),
                    with(Some(r.speed), speed),
                    with(r.amplitude, way),
                    with(r.frequency_hz, ""),
                ]);
            }
            text += &format!("\n{}", columns(&rows));
        }
        if !self.runs.is_empty() {
            let head = [
                "run",
                "DOF",
                "largest speed",
                "amplitude",
                "frequency [Hz]",
                "Re",
                "Fn",
                "KC",
            ];
            let mut rows = vec![head.map(String::from).to_vec()];
            for r in &self.runs {
                let (speed, way) = units_of_motion(r.dof);
                let amplitude = r.amplitude.map(|a| format!("{} {way}", significant(a)));
                rows.push(vec![
                    r.run.clone(),
                    r.dof.to_owned(),
                    format!("{} {speed}", significant(r.speed)),
                    amplitude.unwrap_or_else(|| "-".to_owned()),
                    of(r.frequency_hz),
                    format!("{:.2e}", r.reynolds),
                    significant(r.froude),
                    of(r.keulegan_carpenter),
                ]);
            }
            text += &format!("\n{}", columns(&rows));
        }
        text
    }
}

impl Line {
    /// Its numbers, in the order of the columns.
    fn numbers(&self) -> impl Iterator<Item = &Number> {
        [
            Some(&self.dimensional),
            self.nondimensional.as_ref(),
            self.scaled.as_ref(),
        ]
        .into_iter()
        .flatten()
    }
}

/// Units of a degree of freedom's speed and amplitude.
fn units_of_motion(dof: &str) -> (&'static str, &'static str) {
    let is_turn = Dof::ALL.iter().any(|d| d.name() == dof && d.index() > 2);
    if is_turn {
        ("rad/s", "rad")
    } else {
        ("m/s", "m")
    }
}

/// Rows in columns of even width.
fn columns(rows: &[Vec<String>]) -> String {
    let count = rows.iter().map(Vec::len).max().unwrap_or(0);
    let letters = |cell: &String| cell.chars().filter(|c| !is_combining(*c)).count();
    let width = |k: usize| rows.iter().filter_map(|r| r.get(k)).map(letters).max();
    let widths: Vec<usize> = (0..count).map(|k| width(k).unwrap_or(0)).collect();
    let mut text = String::new();
    for row in rows {
        let mut line = String::new();
        for (cell, width) in row.iter().zip(&widths) {
            line += cell;
            line += &" ".repeat(width + 2 - letters(cell).min(width + 2));
        }
        text += line.trim_end();
        text.push('\n');
    }
    text
}

/// A dot above the letter before it takes no room.
fn is_combining(letter: char) -> bool {
    ('\u{300}'..='\u{36f}').contains(&letter)
}

/// `x_udot` as `X_{\dot u}`, `x_uu` as `X_{u|u|}`, with the system's mark.
fn in_mathematics(key: &str, mark: &str) -> String {
    let Some((load, of)) = key.split_once('_') else {
        return key.to_owned();
    };
    let load = load.to_uppercase();
    let letter = of.chars().next().unwrap_or(' ');
    let by = match of.len() {
        1 => format!("{letter}"),
        2 => format!("{letter}|{letter}|"),
        _ => format!("\\dot {letter}"),
    };
    format!("{load}{mark}_{{{by}}}")
}

/// A number with five digits, with a power of ten where a plain one is long.
fn power(value: f64) -> String {
    let plain = significant(value);
    match plain.split_once('e') {
        Some((digits, exponent)) => format!("{digits} \\times 10^{{{exponent}}}"),
        None => plain,
    }
}

fn unit(unit: &str) -> String {
    unit.replace("m2", "m$^2$").replace(' ', "\\,")
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_rigs::Rig;

    fn fitted() -> Fitted {
        let mut rig = Rig::builtin("lshpi").unwrap();
        rig.identified = Some(hydroline_rigs::Identified {
            coefficients: vec!["x_u".into()],
            values: vec![-20.0],
            sd: vec![2.0],
            covariance: vec![vec![4.0]],
            source: None,
        });
        Fitted::of_rig(&rig).unwrap()
    }

    fn asked() -> Asked {
        Asked {
            prime: Some(Prime::Bis),
            hull: Some(Particulars::of_length(0.5)),
            scale: Some(Scale::by(7.5)),
            density_kgpm3: None,
            viscosity_m2ps: None,
        }
    }

    #[test]
    fn a_line_is_the_same_number_in_each_system_with_its_interval() {
        let table = Table::new(&fitted(), &asked()).unwrap();
        let line = table.coefficients.iter().find(|l| l.key == "x_u").unwrap();
        let unit = 29.777 / (0.5f64 / 9.81).sqrt();
        let bis = line.nondimensional.unwrap();
        assert!((bis.value + 20.0 / unit).abs() < 1e-12);
        assert!((bis.sd.unwrap() - 2.0 / unit).abs() < 1e-12);
        assert!(bis.low.unwrap() < bis.value && bis.value < bis.high.unwrap());
        let scaled = line.scaled.unwrap();
        assert!((scaled.value + 20.0 * 7.5f64.powf(2.5)).abs() < 1e-9);
        let bare = Asked {
            hull: None,
            ..asked()
        };
        let words = Table::new(&fitted(), &bare).unwrap_err().to_string();
        assert!(words.contains("--length"), "{words}");
    }

    #[test]
    fn csv_has_every_digit_and_latex_a_row_for_each() {
        let table = Table::new(&fitted(), &asked()).unwrap();
        let text = table.csv().unwrap();
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        assert_eq!(reader.headers().unwrap().get(6), Some("bis"));
        for (record, line) in reader.records().zip(&table.coefficients) {
            let record = record.unwrap();
            assert_eq!(&record[0], line.key);
            let read: f64 = record[6].parse().unwrap();
            assert_eq!(read, line.nondimensional.unwrap().value);
        }
        let latex = table.latex();
        let rows: Vec<&str> = latex.lines().filter(|l| l.starts_with('$')).collect();
        assert_eq!(rows.len(), 18);
        assert!(
            rows[0].starts_with("$X''_{\\dot u}$ & kg & "),
            "{}",
            rows[0]
        );
        assert!(rows[2].starts_with("$X''_{u|u|}$"), "{}", rows[2]);
        // Of as many cells as the head has columns.
        let columns = latex.lines().nth(1).unwrap();
        assert!(columns.contains("{llrrrrrr}"), "{columns}");
        assert!(rows.iter().all(|r| r.matches('&').count() == 7));
    }

    /// Ranges need no length, and are in the text; Reynolds numbers do, and are not.
    #[test]
    fn ranges_are_there_without_a_length_and_water_is_that_which_was_given() {
        let json = r#"{"parameters":{"x_u":{"value":-20,"sd":1}},
            "runs":[{"name":"a","seen":{"surge":{"speed":0.3,"amplitude":0.1,"frequency_hz":0.2}}},
                    {"name":"b","seen":{"surge":{"speed":0.5},"yaw":{"speed":0.2}}}]}"#;
        let fitted = Fitted::from_json(json, "r.json").unwrap();
        let bare = Asked {
            density_kgpm3: Some(1025.0),
            ..Asked::default()
        };
        let table = Table::new(&fitted, &bare).unwrap();
        assert!(table.runs.is_empty());
        assert_eq!(table.ranges[0].speed, [0.3, 0.5]);
        assert_eq!(table.reference.density_kgpm3, 1025.0);
        assert!(table.missing.iter().any(|m| m.contains("--length")));
        let text = table.text();
        for words in ["surge", "0.30000 .. 0.50000 m/s", "rad/s", "rho = 1025"] {
            assert!(text.contains(words), "no {words:?} in\n{text}");
        }
    }

    #[test]
    fn the_text_says_reference_quantities_and_every_unit() {
        let text = Table::new(&fitted(), &asked()).unwrap().text();
        for words in [
            "bis system",
            "L = 0.5 m",
            "m = 29.777 kg",
            "kg m2/s",
            "X_u̇''",
        ] {
            assert!(text.contains(words), "no {words:?} in\n{text}");
        }
    }
}
