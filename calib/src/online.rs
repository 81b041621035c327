//! Calibration while recording: frame by frame, until the rig's tolerance is met.
//!
//! A state machine without clock or device: the caller pushes detections, it answers with
//! what is known and what is still missing. The board stands still while it is looked at;
//! a board that moves starts the average anew.

mod carry;
pub mod coverage;
mod misfit;

pub use coverage::Coverage;
pub use misfit::Misfit;

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2};

use hydroline_rigs::Board;

use crate::board::coplanarity::Coplanarity;
use crate::calibration::board_map::{Placement, Provenance};
use crate::detect::{Detection, Orientation};
use crate::map::{FitOptions, FittedMap, Method, Node, fit};
use crate::{Calibration, Medium, Residuals};

/// Requirements on the calibration, and options of its fit.
#[derive(Debug, Clone, PartialEq)]
pub struct OnlineOptions {
    /// Map to fit.
    pub method: Method,
    /// Options of the fit.
    pub fit: FitOptions,
    /// Largest standard deviation on the sheet \[m\], in ξ or η.
    pub tolerance_m: f64,
    /// Share of the board's parts that must be covered.
    pub coverage: f64,
    /// Frames at least: the first may catch a hand on the board.
    pub frames: u32,
    /// A gap that nobody measured is accepted (a board without blocks).
    pub accept_unknown_gap: bool,
}

impl Default for OnlineOptions {
    fn default() -> Self {
        OnlineOptions {
            method: Method::Homography,
            fit: FitOptions::default(),
            tolerance_m: 0.5e-3,
            coverage: 0.9,
            frames: 5,
            accept_unknown_gap: false,
        }
    }
}

/// Where the calibration stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Status {
    /// Frames averaged.
    pub frames: u32,
    /// Nodes known.
    pub nodes: usize,
    /// Which parts of the board are covered.
    pub coverage: Coverage,
    /// Fit at the nodes.
    pub residuals: Option<Residuals>,
    /// The same against the nodes' own noise.
    pub misfit: Option<Misfit>,
    /// Which part of the board no node is known of, as the camera sees it: "left half"; `None`: of none.
    pub missing_part: Option<String>,
    /// Largest standard deviation of the map over the board \[m\], gap included, measured or not.
    pub worst_sd_m: Option<f64>,
    /// The same without a gap that nobody measured \[m\]: what the tolerance is held against.
    pub own_sd_m: Option<f64>,
    /// Board against sheet, in words.
    pub gap: Option<String>,
    /// Requirements not yet met, in words; empty when accepted.
    pub missing: Vec<String>,
    /// The calibration meets the tolerance.
    pub accepted: bool,
}

/// One node's average.
#[derive(Debug, Clone, Copy)]
struct Average {
    information: Matrix2<f64>,
    weighted: Vector2<f64>,
    node: Node,
    frames: u32,
}

/// Standard deviation that no number of frames averages away \[px\]: blur, lens and light act on every frame alike.
const FLOOR_PX: f64 = 0.01;
/// A median move of more than this \[px\] is a board that moved.
const MOVED_PX: f64 = 0.5;

/// The state machine.
#[derive(Debug, Clone)]
pub struct OnlineCalibration {
    board: Board,
    /// Which node is which is certain: a frame has shown the key.
    sure: bool,
    options: OnlineOptions,
    nodes: BTreeMap<(u32, u32), Average>,
    frames: u32,
    gap: Option<Coplanarity>,
    fitted: Option<FittedMap>,
}

impl OnlineCalibration {
    /// Starts with nothing known.
    pub fn new(board: Board, options: OnlineOptions) -> Self {
        OnlineCalibration {
            board,
            sure: false,
            options,
            nodes: BTreeMap::new(),
            frames: 0,
            gap: None,
            fitted: None,
        }
    }

    /// A detection under the indices of the board that is known here: a still board keeps its
    /// nodes' indices, also in frames that do not show the key. `None` where it is another pose, or
    /// which node is which is ambiguous.
    pub fn recognise(&self, detection: &Detection) -> Option<Detection> {
        let seen = detection.orientation == Orientation::KeySeen;
        if self.sure && !seen {
            return carry::over(&self.board, &self.nodes(), detection);
        }
        (detection.orientation.is_usable()
            && self.moved_px(detection).is_some_and(|d| d <= MOVED_PX))
        .then(|| detection.clone())
    }

    /// Median distance \[px\] of a detection's nodes from the average; `None` without common nodes.
    fn moved_px(&self, detection: &Detection) -> Option<f64> {
        let mut moved: Vec<f64> = detection
            .nodes
            .iter()
            .filter_map(|n| {
                let old = self.nodes.get(&(n.j, n.i))?.mean();
                Some((old.column_px - n.node.column_px).hypot(old.row_px - n.node.row_px))
            })
            .collect();
        moved.sort_by(f64::total_cmp);
        moved.get(moved.len() / 2).copied()
    }

    /// Takes one frame's nodes and, where measured, the gap; answers with the new standing.
    pub fn push(&mut self, detection: &Detection, gap: Option<Coplanarity>) -> Status {
        let recognised = self.recognise(detection);
        let known = recognised.is_some();
        let detection = recognised.as_ref().unwrap_or(detection);
        if !detection.orientation.is_usable() {
            let mut status = self.status();
            status.accepted = false;
            status.missing.insert(
                0,
                "the board's key is hidden, and which node is which depends on it: uncover its three discs"
                    .to_owned(),
            );
            return status;
        }
        // Another part of the same board, its key in view, has no nodes in common and adds to them.
        let apart =
            detection.orientation == Orientation::KeySeen && self.moved_px(detection).is_none();
        let restarted = !known && !apart && !self.nodes.is_empty();
        // The same places under other indices: the first frames were read without their key.
        let renamed =
            restarted && !self.sure && carry::over(&self.board, &self.nodes(), detection).is_some();
        if restarted {
            self.nodes.clear();
            self.frames = 0;
            self.gap = None;
            self.sure = false;
        }
        self.sure |= detection.orientation == Orientation::KeySeen;
        self.frames += 1;
        for n in &detection.nodes {
            let Some(information) = n.node.covariance_px2.try_inverse() else {
                continue;
            };
            let seen = Vector2::new(n.node.column_px, n.node.row_px);
            let average = self.nodes.entry((n.j, n.i)).or_insert(Average {
                information: Matrix2::zeros(),
                weighted: Vector2::zeros(),
                node: n.node,
                frames: 0,
            });
            average.information += information;
            average.weighted += information * seen;
            average.frames += 1;
        }
        // A measured gap is worth more than none; of two, the surer one.
        if let Some(new) = gap {
            let better = match (&self.gap, &new) {
                (Some(Coplanarity::Measured(old)), Coplanarity::Measured(new)) => {
                    new.offset_sd_m() < old.offset_sd_m()
                }
                (Some(Coplanarity::Measured(_)), Coplanarity::Unknown(_)) => false,
                _ => true,
            };
            if better {
                self.gap = Some(new);
            }
        }
        let mut status = self.status();
        if restarted {
            let why = if renamed {
                "the key came into view and shows another order of the nodes: starting anew"
            } else {
                "the board moved: starting anew, hold it still"
            };
            status.missing.insert(0, why.to_owned());
        }
        status
    }

    /// Averaged nodes.
    pub fn nodes(&self) -> Vec<Node> {
        self.nodes.values().map(Average::mean).collect()
    }

    fn status(&mut self) -> Status {
        let nodes = self.nodes();
        let coverage = Coverage::of(&self.board, nodes.iter().map(|n| [n.xi_m, n.eta_m]));
        let mut missing = coverage.missing();
        self.fitted = match fit(self.options.method, &nodes, &self.options.fit) {
            Ok(map) => Some(map),
            Err(error) => {
                missing.push(error.to_string());
                None
            }
        };
        let sd_m = self.fitted.as_ref().and_then(|map| self.worst_sd_m(map));
        let (own_sd_m, worst_sd_m) = sd_m.unzip();
        let residuals = self.calibration(Provenance {
            medium: Medium::Air, // of no consequence to the residuals
            date: None,
            board: self.board.name.clone(),
            placement: Placement::default(),
            coplanarity: self.gap_or_unknown(),
            image: None,
            missing: Vec::new(),
        });
        if self.frames < self.options.frames {
            missing.push(format!("{} of {} frames", self.frames, self.options.frames));
        }
        if let Some(sd) = own_sd_m
            && sd > self.options.tolerance_m
        {
            missing.push(format!(
                "map uncertain by {:.2} mm, {:.2} mm wanted",
                1e3 * sd,
                1e3 * self.options.tolerance_m
            ));
        }
        if !self.options.accept_unknown_gap && !self.gap.as_ref().is_some_and(Coplanarity::claims) {
            missing.push(self.gap_or_unknown().words());
        }
        let accepted = self.fitted.is_some()
            && own_sd_m.is_some_and(|sd| sd <= self.options.tolerance_m)
            && coverage.share() >= self.options.coverage
            && self.frames >= self.options.frames
            && (self.options.accept_unknown_gap
                || self.gap.as_ref().is_some_and(Coplanarity::claims));
        if accepted {
            missing.clear();
        }
        Status {
            frames: self.frames,
            misfit: (self.fitted.as_ref()).and_then(|map| Misfit::of(&self.board, map, &nodes)),
            missing_part: coverage::missing_part(
                &self.board,
                self.nodes.keys().map(|&(j, i)| [i, j]),
            ),
            nodes: nodes.len(),
            coverage,
            residuals: residuals.and_then(|c| c.residuals),
            worst_sd_m,
            own_sd_m,
            gap: self.gap.as_ref().map(Coplanarity::words),
            missing,
            accepted,
        }
    }

    fn gap_or_unknown(&self) -> Coplanarity {
        // Without a camera of the rig at hand: as far away as the board is large.
        let distance = 0.5 * f64::from(self.board.rows) * self.board.pitch_m + 0.1;
        self.gap
            .clone()
            .unwrap_or_else(|| Coplanarity::unknown("not looked at", [0.0, distance, distance]))
    }

    /// Largest standard deviation over a grid of the map's region \[m\]: as it is judged, with the gap
    /// where it was measured, and as it is reported, with the gap in any case.
    fn worst_sd_m(&self, map: &FittedMap) -> Option<(f64, f64)> {
        let (low, high) = map.region().bounds_m()?;
        let gap = self.gap_or_unknown();
        let measured = matches!(gap, Coplanarity::Measured(_));
        let mut worst: Option<(f64, f64)> = None;
        for j in 0..=6 {
            for i in 0..=6 {
                let xi = low[0] + (high[0] - low[0]) * f64::from(i) / 6.0;
                let eta = low[1] + (high[1] - low[1]) * f64::from(j) / 6.0;
                if let Some(p) = map.to_image(xi, eta).and_then(|(c, r)| map.to_plane(c, r)) {
                    let sd = |c: Matrix2<f64>| c[(0, 0)].max(c[(1, 1)]).max(0.0).sqrt();
                    let all = sd(p.covariance_m2 + gap.covariance_m2(xi, eta));
                    let own = if measured { all } else { sd(p.covariance_m2) };
                    worst = Some(worst.map_or((own, all), |w| (w.0.max(own), w.1.max(all))));
                }
            }
        }
        worst
    }

    /// The calibration as it stands; `None` before the first fit. `provenance.coplanarity`
    /// is replaced by the measured gap where there is one.
    pub fn calibration(&self, provenance: Provenance) -> Option<Calibration> {
        let map = self.fitted.clone()?;
        let coplanarity = self.gap.clone().unwrap_or(provenance.coplanarity);
        Some(Calibration::of_board(
            map,
            &self.nodes(),
            Provenance {
                coplanarity,
                ..provenance
            },
        ))
    }
}

impl Average {
    fn mean(&self) -> Node {
        let covariance = self.information.try_inverse();
        let Some(covariance) = covariance else {
            return self.node;
        };
        let at = covariance * self.weighted;
        Node {
            column_px: at[0],
            row_px: at[1],
            covariance_px2: covariance + Matrix2::identity() * FLOOR_PX * FLOOR_PX,
            ..self.node
        }
    }
}

#[cfg(test)]
mod tests;
