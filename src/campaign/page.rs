//! The campaign to look at: what changed, trends over time, runs beside each other, what is covered, what to run next.

use crate::group::Group;
use crate::sheet::{ChangeSheet, SetSheet};
use crate::table::{Row, word};
use crate::unit::Task;
use crate::work::Campaign;
use hydroline_report::{Axis, Body, Colour, Figure, Page, Panel, Table, significant};

/// Rows of runs that a page shows; all of them stand in the table beside it.
const ROWS_MAX: usize = 10_000;
/// Trends are drawn of this many coefficients of a group: the best determined.
const TRENDS: usize = 6;
/// Points of a trend: of more runs each point is of several, one after the other.
const TREND_POINTS: usize = 300;
/// Nanoseconds in a day.
const DAY_NS: f64 = 86_400e9;

/// The page.
pub fn page(campaign: &Campaign<'_>, rows: &[Row], command: &str) -> Page {
    let bad = rows.iter().filter(|r| word(r, "kind") == "bad").count();
    let runs = rows.iter().filter(|r| word(r, "kind") == "run").count();
    let mut page = Page::new("Campaign", "Campaign");
    let b = &mut page.body;
    b.lead(format!(
        "{runs} runs of {} group(s); {bad} file(s) that cannot be used.",
        campaign.groups.len()
    ));
    b.listing(command);
    if bad > 0 {
        b.section("Files that cannot be used");
        let mut table = Table::new(["file", "why"]);
        for row in rows.iter().filter(|r| word(r, "kind") == "bad") {
            table.row([word(row, "log"), word(row, "remarks")]);
        }
        b.table(table);
    }
    for (g, group) in campaign.groups.iter().enumerate() {
        of_group(b, campaign, g, group, rows);
    }
    b.section("Runs");
    let mut table = Table::new([
        "group", "date", "log", "plan", "sound", "verdict", "effects", "remarks",
    ]);
    let listed = rows.iter().filter(|r| word(r, "kind") == "run");
    for row in listed.take(ROWS_MAX) {
        table.row(
            [
                "group", "date", "log", "plan", "sound", "verdict", "effects", "remarks",
            ]
            .map(|c| word(row, c)),
        );
    }
    b.table(table);
    if runs > ROWS_MAX {
        b.paragraph(format!("{} more stand in runs.csv.", runs - ROWS_MAX));
    }
    page
}

fn of_group(b: &mut Body, campaign: &Campaign<'_>, g: usize, group: &Group, rows: &[Row]) {
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
    trends(b, group, rows);
    coverage(b, group, rows);
}

fn of<'r>(group: &'r Group, rows: &'r [Row]) -> impl Iterator<Item = &'r Row> {
    rows.iter()
        .filter(|r| word(r, "kind") == "run" && word(r, "group") == group.id)
}

/// Coefficients over time, run by run.
fn trends(b: &mut Body, group: &Group, rows: &[Row]) {
    let mut keys: Vec<(String, usize)> = Vec::new();
    for row in of(group, rows) {
        for key in row.keys().filter_map(|k| k.strip_suffix("_sd")) {
            match keys.iter_mut().find(|(k, _)| k == key) {
                Some((_, n)) => *n += 1,
                None if row.contains_key(key) => keys.push((key.to_owned(), 1)),
                None => {}
            }
        }
    }
    keys.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    let first = of(group, rows)
        .filter_map(|r| value(r, "start_ns"))
        .fold(f64::INFINITY, f64::min);
    let panels: Vec<Panel> = keys
        .iter()
        .take(TRENDS)
        .filter_map(|(key, _)| {
            let points: Vec<[f64; 3]> = of(group, rows)
                .filter_map(|r| {
                    let day = (value(r, "start_ns")? - first) / DAY_NS;
                    Some([day, value(r, key)?, value(r, &format!("{key}_sd"))?])
                })
                .collect();
            (points.len() > 1).then(|| {
                let (points, each) = thinned(points);
                let name = match each {
                    1 => "run (± 2 sd)".to_owned(),
                    n => format!("median of {n} runs, with where 95 % of them lie"),
                };
                let dots = points.iter().map(|p| [p[0], p[1]]).collect();
                let mut panel = Panel::new(
                    key.clone(),
                    Axis::new("days since the first run"),
                    Axis::new(key.clone()),
                );
                for [x, _, low, high] in &points {
                    panel = panel.line("", Colour::series(1), vec![[*x, *low], [*x, *high]]);
                }
                panel.dots(&name, Colour::series(0), dots)
            })
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

/// Which loads and rates the runs cover.
fn coverage(b: &mut Body, group: &Group, rows: &[Row]) {
    let mut table = Table::new(["channel", "least", "greatest", "runs"]);
    let mut any = false;
    for channel in hydroline_identify::data::CHANNELS {
        let ranges: Vec<[f64; 2]> = of(group, rows)
            .filter_map(|r| {
                Some([
                    value(r, &format!("least_{channel}"))?,
                    value(r, &format!("greatest_{channel}"))?,
                ])
            })
            .collect();
        if ranges.is_empty() {
            continue;
        }
        any = true;
        let least = ranges.iter().map(|r| r[0]).fold(f64::INFINITY, f64::min);
        let greatest = ranges
            .iter()
            .map(|r| r[1])
            .fold(f64::NEG_INFINITY, f64::max);
        table.row([
            channel.to_owned(),
            significant(least),
            significant(greatest),
            ranges.len().to_string(),
        ]);
    }
    if any {
        b.subsection("Range of operation covered (SI)");
        b.table(table);
    }
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
