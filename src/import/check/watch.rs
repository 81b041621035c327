//! Looks at a table of any length, a stretch at a time.

use std::ops::RangeInclusive;

use hydroline_rigs::Rig;

use super::channel::{self, Extent};
use super::clock_steps;
use super::clocks::Clocks;
use super::commands::Loads;
use super::drift::Drift;
use super::{Finding, FindingList, Options, Severity, jumps, kinematics, name, names, too_short};
use crate::map::{Map, Origin, PLACES};
use crate::table::{Imported, Sample};

/// Rows of one stretch: 22 minutes at 100 Hz.
const STRETCH_ROWS: usize = 1 << 17;
/// Rows of the last stretch that the next one begins with.
const OVERLAP_ROWS: usize = 8;
/// Lost values are remembered up to so many groups.
const GROUPS_MAX: usize = 1 << 16;

/// Values to be left out, by place: lines of the file.
#[derive(Debug, Clone, Default)]
pub(crate) struct Spoilt {
    groups: Vec<(usize, RangeInclusive<u64>)>,
}

impl Spoilt {
    /// In the order in which a writer meets them.
    fn new(mut groups: Vec<(usize, RangeInclusive<u64>)>) -> Self {
        groups.sort_by_key(|g| *g.1.start());
        Spoilt { groups }
    }

    /// Takes the spoilt values out of a table.
    pub fn clear_all(&self, data: &mut Imported) {
        for (place, lines) in &self.groups {
            let from = data.lines.partition_point(|l| l < lines.start());
            let to = data.lines.partition_point(|l| l <= lines.end());
            if let Some(values) = data.motion[*place].get_mut(from..to) {
                values.fill(f64::NAN);
            }
        }
    }

    /// Takes the spoilt values out of a row; how many there were. Rows come in the order of their lines.
    pub fn clear(&self, at: &mut usize, sample: &mut Sample) -> usize {
        while self
            .groups
            .get(*at)
            .is_some_and(|g| *g.1.end() < sample.line)
        {
            *at += 1;
        }
        let mut cleared = 0;
        for (place, lines) in &self.groups[*at..] {
            if *lines.start() > sample.line {
                break;
            }
            if lines.contains(&sample.line) && sample.values[*place].is_finite() {
                sample.values[*place] = f64::NAN;
                cleared += 1;
            }
        }
        cleared
    }
}

/// Findings of all stretches.
pub(crate) struct Watch<'a> {
    map: &'a Map,
    rig: Option<&'a Rig>,
    options: Options,
    stretch: Imported,
    /// Rows of the stretch that the last one held too.
    old: usize,
    stretches: usize,
    rows: usize,
    clocks: Clocks,
    /// Order of all rows, where only some are samples of motion.
    order: Option<Clocks>,
    extents: [Extent; PLACES],
    drift: Drift,
    loads: Loads,
    found: Vec<(Finding, usize)>,
    spoilt: Vec<(usize, RangeInclusive<u64>)>,
}

impl<'a> Watch<'a> {
    pub fn new(map: &'a Map, rig: Option<&'a Rig>, options: Options) -> Self {
        Watch {
            map,
            rig,
            options,
            stretch: Imported::empty(map),
            old: 0,
            stretches: 0,
            rows: 0,
            clocks: Clocks::default(),
            order: (map.sparse() && map.has_motion()).then(Clocks::default),
            extents: [Extent::default(); PLACES],
            drift: Drift::default(),
            loads: Loads::new(map),
            found: Vec::new(),
            spoilt: Vec::new(),
        }
    }

    pub fn row(&mut self, sample: &Sample) {
        self.stretch.push(sample, self.map);
        self.rows += 1;
        if self.stretch.times_s.len() == STRETCH_ROWS {
            self.look();
            let kept = STRETCH_ROWS - OVERLAP_ROWS;
            let rest: Vec<Sample> = (kept..STRETCH_ROWS)
                .map(|k| self.stretch.sample(k))
                .collect();
            self.stretch = Imported::empty(self.map);
            for sample in &rest {
                self.stretch.push(sample, self.map);
            }
            self.old = OVERLAP_ROWS;
        }
    }

    fn look(&mut self) {
        let data = std::mem::take(&mut self.stretch);
        if data.times_s.len() - self.old < 1 || data.times_s.len() < 4 {
            self.stretch = data;
            return;
        }
        self.stretches += 1;
        self.times(&data);
        self.drift.add(&data.times_s, &data.compare_s);
        self.loads.stretch(&data, self.old);
        let mut findings = Vec::new();
        let mut lost: Vec<(usize, std::ops::Range<usize>)> = Vec::new();
        let lines = |r: std::ops::Range<usize>| data.lines[r.start]..=data.lines[r.end - 1];
        for (place, values) in data.motion.iter().enumerate() {
            if values.is_empty() || self.is_constant(place) {
                continue;
            }
            self.extents[place].add(&values[self.old..]);
            channel::check(place, values, &data, &self.options, &mut findings);
            let found = jumps::check(place, self.zero(place), &data, &self.options);
            // Where a unit is wrong everything jumps.
            if !findings.iter().any(|f| {
                f.kind == "units" && f.severity == Severity::Fault && f.subject() == name(place)
            }) {
                findings.extend(found.findings);
                let spoilt = found.spoilt.into_iter().map(|r| (place, lines(r)));
                self.spoilt.extend(spoilt);
                lost.extend(found.lost.into_iter().map(|r| (place, r)));
            }
        }
        let (more, said) = jumps::of_the_same_body(&lost, |p| self.zero(p), &data);
        findings.extend(said);
        let all = lost.into_iter().chain(more);
        self.spoilt.extend(all.map(|(place, r)| (place, lines(r))));
        self.spoilt.truncate(GROUPS_MAX);
        let assumed = kinematics::Assumed {
            sparse: self.map.sparse(),
            in_tank: self.map.channels.iter().any(|c| c.in_tank),
        };
        kinematics::check(&data, assumed, &self.options, &mut findings);
        clock_steps::check(&data, &self.options, clock_steps::by_map, &mut findings);
        for finding in findings {
            self.merge(finding);
        }
        self.stretch = data;
    }

    fn times(&mut self, data: &Imported) {
        let Some(order) = &mut self.order else {
            self.clocks.stretch(&data.times_s, &data.lines, self.old);
            return;
        };
        order.stretch(&data.times_s, &data.lines, self.old);
        // Channels of several rates stand in rows of their own: the densest one tells rate and gaps.
        let measured = |v: &Vec<f64>| v.iter().filter(|v| v.is_finite()).count();
        let Some(densest) = data.motion.iter().max_by_key(|v| measured(v)) else {
            return;
        };
        let moved = |k: &usize| densest.get(*k).is_some_and(|v| v.is_finite());
        let rows: Vec<usize> = (0..data.times_s.len()).filter(moved).collect();
        let old = rows.iter().filter(|k| **k < self.old).count();
        let times_s: Vec<f64> = rows.iter().map(|k| data.times_s[*k]).collect();
        let lines: Vec<u64> = rows.iter().map(|k| data.lines[*k]).collect();
        self.clocks.stretch(&times_s, &lines, old);
    }

    fn is_constant(&self, place: usize) -> bool {
        let own = self.map.channels.iter().find(|c| c.place == place);
        own.is_some_and(|c| matches!(c.origin, Origin::Value(_)))
    }

    /// Channel's value for a 0 in the file; NaN where it is mixed with other columns.
    fn zero(&self, place: usize) -> f64 {
        // A lost body's quaternion is that of no turn.
        if (3..6).contains(&place) && self.map.quaternion.is_some() {
            return 0.0;
        }
        let own = self.map.channels.iter().find(|c| c.place == place);
        own.filter(|c| !c.in_tank).map_or(f64::NAN, |c| c.offset)
    }

    /// The first of a kind about a channel stands for all.
    fn merge(&mut self, finding: Finding) {
        let same = |f: &&mut (Finding, usize)| {
            f.0.kind == finding.kind
                && f.0.severity == finding.severity
                && (f.0.subject() == finding.subject() || f.0.kind == "clock_step")
                && (f.0.kind != "kinematics" || f.0.message.get(..5) == finding.message.get(..5))
        };
        match self.found.iter_mut().find(same) {
            Some(f) => f.1 += 1,
            None => self.found.push((finding, 1)),
        }
    }

    /// Everything found, and what is to be left out.
    pub fn finish(mut self) -> (Vec<Finding>, Spoilt) {
        self.look();
        let mut findings = Vec::new();
        if self.rows < 4 {
            findings.push(too_short(self.rows));
            return (findings, Spoilt::default());
        }
        let mut advances = self.clocks.report(&mut findings);
        if let Some(order) = &self.order {
            order.report_order(&mut findings);
        }
        if !self.map.has_motion() {
            advances = true;
            findings.info(
                "no_motion",
                "the map names no channel of motion: a log of commands alone".to_owned(),
            );
        }
        if advances {
            self.drift.report(&mut findings);
            for place in
                (0..PLACES).filter(|p| self.map.missing(*p).is_some() && !self.is_constant(*p))
            {
                self.extents[place].report(place, &mut findings);
            }
            self.add_found(&mut findings);
        }
        self.loads.report(self.map, self.rig, &mut findings);
        names::check(self.map, &mut findings);
        names::sds(self.map, &mut findings);
        (findings, Spoilt::new(self.spoilt))
    }

    fn add_found(&mut self, findings: &mut Vec<Finding>) {
        let all = self.stretches;
        for (mut finding, seen) in std::mem::take(&mut self.found) {
            // At rest a rate follows nothing: only if that is so throughout is it the column.
            if finding.kind == "kinematics" && finding.severity == Severity::Warning && seen < all {
                continue;
            }
            if finding.severity > Severity::Info && seen > 1 {
                finding.message += &format!(" (so in {seen} of {all} stretches of the table)");
            }
            findings.push(finding);
        }
    }
}
