//! The campaign to look at: what changed, trends over time, runs beside each other, what is covered, what to run next.

use crate::group::Group;
use crate::kind::Kind;
use crate::overlay::{self, Drawn};
use crate::sheet::{ChangeSheet, SetSheet};
use crate::store::StoreError;
use crate::table::{Row, Table as Rows, word};
use crate::unit::Task;
use crate::work::Campaign;
use hydroline_core::run::Channel;
use hydroline_report::{Axis, Body, Colour, Figure, Page, Panel, Table, significant};
use std::cmp::Reverse;
use std::collections::BTreeMap;

/// Rows of runs that a page shows; all of them stand in the table beside it.
const ROWS_MAX: usize = 10_000;
/// Trends are drawn of this many coefficients of a group: the best determined.
const TRENDS: usize = 6;
/// Plans of a group whose runs are drawn over each other: those with most runs.
const PLANS: usize = 6;
/// Points of a trend: of more runs each point is of several, one after the other.
const TREND_POINTS: usize = 300;
const DAY_NS: f64 = 86_400e9;

/// Columns of the table of runs.
const LISTED: [&str; 8] = [
    "group", "date", "log", "plan", "sound", "verdict", "effects", "remarks",
];

/// Rows as the page shows them, gathered one by one.
#[derive(Default)]
struct Gathered {
    /// Files that cannot be used, with why.
    bad: Vec<[String; 2]>,
    runs: usize,
    listed: Vec<[String; LISTED.len()]>,
    groups: BTreeMap<String, OfGroup>,
}

/// Of the runs of one group.
#[derive(Default)]
struct OfGroup {
    /// First message of the first run, UNIX \[ns\].
    first_ns: Option<f64>,
    /// In how many runs a coefficient is determined.
    determined: BTreeMap<String, usize>,
    /// Least and greatest per channel, and of how many runs.
    covered: BTreeMap<&'static str, ([f64; 2], usize)>,
    plans: BTreeMap<String, Vec<Drawn>>,
    /// Of the coefficients that are drawn: time since the first run \[d\], value, sd.
    trends: Vec<(String, Vec<[f64; 3]>)>,
}

impl Gathered {
    fn of(campaign: &Campaign<'_>, rows: &Rows) -> Result<Self, StoreError> {
        let mut found = Self::default();
        let keys: BTreeMap<&str, &str> = campaign
            .units
            .iter()
            .filter_map(|unit| match unit.task {
                Task::Run { log } => Some((campaign.logs[log].name.as_str(), unit.key.as_str())),
                _ => None,
            })
            .collect();
        for row in rows.rows()? {
            let row = row?;
            match Kind::of(&row) {
                Some(Kind::Bad) => found.bad.push(["log", "remarks"].map(|c| word(&row, c))),
                Some(Kind::Run) => {
                    found.runs += 1;
                    if found.runs <= ROWS_MAX {
                        found.listed.push(LISTED.map(|c| word(&row, c)));
                    }
                    let group = found.groups.entry(word(&row, "group")).or_default();
                    group.add(&row);
                    // A copy of a log has no unit of its own, and is drawn once.
                    if let Some(key) = keys.get(word(&row, "log").as_str()) {
                        let runs = group.plans.entry(word(&row, "plan")).or_default();
                        runs.push(Drawn::of(&row, key));
                    }
                }
                _ => {}
            }
        }
        for group in found.groups.values_mut() {
            group.choose();
        }
        for row in rows.rows()? {
            let row = row?;
            if Kind::of(&row) == Some(Kind::Run)
                && let Some(group) = found.groups.get_mut(&word(&row, "group"))
            {
                group.draw(&row);
            }
        }
        Ok(found)
    }
}

impl OfGroup {
    fn add(&mut self, row: &Row) {
        if let Some(start_ns) = value(row, "start_ns") {
            self.first_ns = Some(self.first_ns.map_or(start_ns, |f| f.min(start_ns)));
        }
        for key in row.keys().filter_map(|k| k.strip_suffix("_sd")) {
            if row.contains_key(key) {
                *self.determined.entry(key.to_owned()).or_default() += 1;
            }
        }
        for channel in Channel::ALL.map(Channel::name) {
            let least = value(row, &format!("least_{channel}"));
            let greatest = value(row, &format!("greatest_{channel}"));
            if let (Some(least), Some(greatest)) = (least, greatest) {
                let nothing = ([f64::INFINITY, f64::NEG_INFINITY], 0);
                let (range, runs) = self.covered.entry(channel).or_insert(nothing);
                *range = [range[0].min(least), range[1].max(greatest)];
                *runs += 1;
            }
        }
    }

    /// Trends are drawn of what most runs determine.
    fn choose(&mut self) {
        let mut keys: Vec<(&String, &usize)> = self.determined.iter().collect();
        keys.sort_by(|a, b| b.1.cmp(a.1).then(a.0.cmp(b.0)));
        let drawn = keys.iter().take(TRENDS);
        self.trends = drawn.map(|(key, _)| ((*key).clone(), Vec::new())).collect();
    }

    fn draw(&mut self, row: &Row) {
        let (Some(start_ns), Some(first_ns)) = (value(row, "start_ns"), self.first_ns) else {
            return;
        };
        for (key, points) in &mut self.trends {
            if let (Some(y), Some(sd)) = (value(row, key), value(row, &format!("{key}_sd"))) {
                points.push([(start_ns - first_ns) / DAY_NS, y, sd]);
            }
        }
    }
}

/// The page.
///
/// # Errors
/// [`StoreError`]: the table cannot be read back.
pub fn page(campaign: &Campaign<'_>, rows: &Rows, command: &str) -> Result<Page, StoreError> {
    let mut found = Gathered::of(campaign, rows)?;
    let mut page = Page::new("Campaign", "Campaign");
    let b = &mut page.body;
    b.lead(format!(
        "{} runs of {} group(s); {} file(s) that cannot be used.",
        found.runs,
        campaign.groups.len(),
        found.bad.len()
    ));
    b.listing(command);
    if !found.bad.is_empty() {
        b.section("Files that cannot be used");
        let mut table = Table::new(["file", "why"]);
        for row in found.bad {
            table.row(row);
        }
        b.table(table);
    }
    for (g, group) in campaign.groups.iter().enumerate() {
        let runs = found.groups.remove(&group.id).unwrap_or_default();
        of_group(b, campaign, g, group, runs);
    }
    b.section("Runs");
    let mut table = Table::new(LISTED);
    for row in found.listed {
        table.row(row);
    }
    b.table(table);
    if found.runs > ROWS_MAX {
        b.paragraph(format!("{} more stand in runs.csv.", found.runs - ROWS_MAX));
    }
    Ok(page)
}

fn of_group(b: &mut Body, campaign: &Campaign<'_>, g: usize, group: &Group, runs: OfGroup) {
    b.section(format!("{} ({})", group.vehicle, group.id));
    let unit = |task: Task| campaign.units.iter().find(|u| u.task == task);
    if let Some(sheet) =
        unit(Task::Changes { group: g }).and_then(|u| campaign.store.get::<ChangeSheet>(&u.key))
    {
        b.subsection("From day to day");
        b.list(sheet.changes.iter().map(|c| match c {
            Ok(change) => change.sentence.clone(),
            Err(why) => why.clone(),
        }));
    }
    let whole = unit(Task::Group { group: g }).and_then(|u| campaign.store.get::<SetSheet>(&u.key));
    if let Some(sheet) = &whole {
        b.subsection("Runs together, since the last change");
        match &sheet.diagnosed {
            Ok(found) => b.paragraph(found.sentence.clone()),
            Err(why) => b.paragraph(why.clone()),
        }
        if let Ok(found) = &sheet.identified {
            let mut table = Table::new(["coefficient", "value", "sd", "rig"]);
            for (key, n) in found.numbers.iter().filter(|(_, n)| n.sd.is_some()) {
                table.row([
                    key.clone(),
                    significant(n.value),
                    n.sd.map_or(String::new(), significant),
                    significant(n.rig),
                ]);
            }
            b.table(table);
        }
        if !sheet.outliers.is_empty() {
            b.subsection("Outlier runs");
            b.list(sheet.outliers.iter().map(|(run, ratio)| {
                format!("{run}: predicted by the others {ratio:.1} times worse than the median run")
            }));
        }
        if !sheet.left.is_empty() {
            b.subsection("Not fitted");
            b.list(sheet.left.clone());
        }
        if let Ok(found) = &sheet.diagnosed
            && !found.next_plan.is_empty()
        {
            b.paragraph(format!("To run next: {}.", found.next_plan));
        }
    }
    let fitted = whole.as_ref().and_then(|s| s.identified.as_ref().ok());
    let channels = overlay::channels(&runs.covered, fitted);
    let mut plans: Vec<(&String, &Vec<Drawn>)> = runs.plans.iter().collect();
    plans.sort_by_key(|(plan, drawn)| (Reverse(drawn.len()), *plan));
    for (plan, drawn) in plans.into_iter().take(PLANS) {
        let plan = if plan.is_empty() { "no plan" } else { plan };
        if let Some((figure, caption)) = overlay::overlay(plan, drawn, &channels, campaign.store) {
            b.figure(&figure, caption);
        }
    }
    trends(b, runs.trends);
    coverage(b, &runs.covered);
}

/// Coefficients over time, run by run.
fn trends(b: &mut Body, trends: Vec<(String, Vec<[f64; 3]>)>) {
    let panels: Vec<Panel> = trends
        .into_iter()
        .filter(|(_, points)| points.len() > 1)
        .map(|(key, points)| {
            let (points, each) = thinned(points);
            let name = match each {
                1 => "run (± 2 sd)".to_owned(),
                n => format!("median of {n} runs, with where 95 % of them lie"),
            };
            let dots = points.iter().map(|p| [p[0], p[1]]).collect();
            let mut panel = Panel::new(
                key.clone(),
                Axis::new("days since the first run"),
                Axis::new(key),
            );
            for [x, _, low, high] in &points {
                panel = panel.line("", Colour::series(1), vec![[*x, *low], [*x, *high]]);
            }
            panel.dots(&name, Colour::series(0), dots)
        })
        .collect();
    if !panels.is_empty() {
        b.figure(
            &Figure::stack("Coefficients, run by run", panels),
            "Coefficients that each run gives by itself, with two standard deviations, over time.",
        );
    }
}

/// Time, value, and ends of a bar: each run with two sd; or, of many runs, the median of so many that follow each other, with
/// their quantiles. How many runs a point is of.
fn thinned(mut points: Vec<[f64; 3]>) -> (Vec<[f64; 4]>, usize) {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let each = points.len().div_ceil(TREND_POINTS);
    if each < 2 {
        let bar = |[x, y, sd]: &[f64; 3]| [*x, *y, y - 2.0 * sd, y + 2.0 * sd];
        return (points.iter().map(bar).collect(), 1);
    }
    let of_many = points.chunks(each).map(|chunk| {
        let mut values: Vec<f64> = chunk.iter().map(|p| p[1]).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values[(share * (values.len() - 1) as f64).round() as usize];
        let time = chunk.iter().map(|p| p[0]).sum::<f64>() / chunk.len() as f64;
        [time, at(0.5), at(0.025), at(0.975)]
    });
    (of_many.collect(), each)
}

/// Table of the loads and rates that the runs cover.
fn coverage(b: &mut Body, covered: &BTreeMap<&'static str, ([f64; 2], usize)>) {
    if covered.is_empty() {
        return;
    }
    let mut table = Table::new(["channel", "least", "greatest", "runs"]);
    for channel in Channel::ALL.map(Channel::name) {
        if let Some(([least, greatest], runs)) = covered.get(channel) {
            table.row([
                channel.to_owned(),
                significant(*least),
                significant(*greatest),
                runs.to_string(),
            ]);
        }
    }
    b.subsection("Range of operation covered (SI)");
    b.table(table);
}

fn value(row: &Row, column: &str) -> Option<f64> {
    row.get(column)?.as_f64()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trend_of_many_runs_has_points_of_several_with_their_quantiles() {
        let run = |k: usize| [k as f64, (k % 41) as f64, 0.1];
        let (few, each) = thinned((0..TREND_POINTS).map(run).collect());
        assert_eq!((few.len(), each), (TREND_POINTS, 1));
        assert_eq!(few[7], [7.0, 7.0, 6.8, 7.2]);
        let (many, each) = thinned((0..41 * TREND_POINTS).rev().map(run).collect());
        assert_eq!((many.len(), each), (TREND_POINTS, 41));
        for [_, median, low, high] in many {
            assert_eq!((low, median, high), (1.0, 20.0, 39.0));
        }
    }
}
