//! The hexagon chain: from the edge points A, B, C, D to ψ_S and X_S.

use super::EstimatorFault;
use crate::segments::{Levels, Step};
use hydroline_rigs::{SlabOutline, Target};

/// Farthest a fix may lie from where continuity expects it \[m\]: half a hexagon.
const HALF: f64 = 0.5;
/// Yaw beyond which the line no longer crosses the chain side to side \[rad\].
const PSI_MAX_RAD: f64 = 0.6;

/// The edge points of one crossing, port to starboard: board, hexagon, hexagon, board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Port edge of the lowest upper face.
    pub a: Option<Step>,
    /// Port edge of the highest upper face.
    pub b: Option<Step>,
    /// Starboard edge of the highest upper face.
    pub c: Option<Step>,
    /// Starboard edge of the lowest upper face.
    pub d: Option<Step>,
}

impl Crossing {
    /// The edge points of a sorted stripe; `heights_m` ascending with the floor first.
    pub fn new(levels: &Levels, heights_m: &[f64]) -> Self {
        let low = heights_m.get(1).copied().unwrap_or(0.0);
        let high = heights_m.last().copied().unwrap_or(0.0);
        let find = |height: f64, to_starboard: bool| {
            let mut all = levels
                .steps
                .iter()
                .filter(move |s| {
                    (s.upper_m - height).abs() < 1e-6 && s.to_starboard == to_starboard
                })
                .copied();
            // Columns grow to starboard: the outermost of each side.
            if to_starboard {
                all.next_back()
            } else {
                all.next()
            }
        };
        Crossing {
            a: find(low, false),
            b: find(high, false),
            c: find(high, true),
            d: find(low, true),
        }
    }

    /// l and r: from the middle of A′D′ to B and to C \[m\].
    ///
    /// # Errors
    /// [`EstimatorFault::NoEdge`] naming the point that is missing.
    pub fn half_widths_m(&self, what: &'static str) -> Result<(f64, f64), EstimatorFault> {
        let xi = |step: Option<Step>, point: char| {
            step.map(|s| s.xi_m)
                .ok_or(EstimatorFault::NoEdge { what, point })
        };
        let centre = 0.5 * (xi(self.a, 'A')? + xi(self.d, 'D')?);
        Ok((xi(self.b, 'B')? - centre, centre - xi(self.c, 'C')?))
    }
}

/// A straight flank: half width = a + s X between `from_m` and `to_m`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Flank {
    a: f64,
    s: f64,
    from_m: f64,
    to_m: f64,
}

/// Where the line crosses the chain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChainFix {
    /// ψ_S: yaw between the path and the chain's centre line \[rad\].
    pub psi_s_rad: f64,
    /// X_S: where the line's middle crosses the centre line \[m\].
    pub x_s_m: f64,
    /// Distance along X of the nearer of B and C from a joint or widest point \[m\].
    pub from_corner_m: f64,
}

/// The chain's flanks.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    flanks: Vec<Flank>,
    pitch_m: f64,
}

impl Chain {
    /// The hexagons of a target; `None` where it has none.
    pub fn new(target: &Target) -> Option<Self> {
        target.slabs.iter().find_map(|slab| match slab.outline {
            SlabOutline::HexagonChain {
                x0_m,
                side_m,
                count,
            } => {
                let half = 0.5 * 3f64.sqrt() * side_m;
                let s = 1.0 / 3f64.sqrt();
                let flanks = (0..2 * count).map(|k| {
                    let from_m = x0_m + half * f64::from(k);
                    let (slope, width) = if k % 2 == 0 {
                        (s, 0.5 * side_m)
                    } else {
                        (-s, side_m)
                    };
                    Flank {
                        a: width - slope * from_m,
                        s: slope,
                        from_m,
                        to_m: from_m + half,
                    }
                });
                Some(Chain {
                    flanks: flanks.collect(),
                    pitch_m: 2.0 * half,
                })
            }
            _ => None,
        })
    }

    /// ψ_S and X_S of one crossing, each point on the flank it is really on, nearest to what
    /// continuity expects: `near` = (X_S \[m\], ψ_S \[rad\]).
    ///
    /// l cos ψ = w(X + l sin ψ), r cos ψ = w(X − r sin ψ) with w = a + s X on the flank of each.
    ///
    /// # Errors
    /// [`EstimatorFault`]: a point is missing, or the widths fit nowhere within half a hexagon.
    pub fn fix(&self, crossing: &Crossing, near: (f64, f64)) -> Result<ChainFix, EstimatorFault> {
        let (l, r) = crossing.half_widths_m("the hexagon's flanks")?;
        let (x_near, psi_near) = near;
        let mut best: Option<(f64, ChainFix)> = None;
        for left in &self.flanks {
            for right in &self.flanks {
                for psi in yaws(left, right, l, r) {
                    if psi.abs() > PSI_MAX_RAD {
                        continue;
                    }
                    let (sin, cos) = psi.sin_cos();
                    let x = (l * cos - left.a) / left.s - l * sin;
                    let (at_l, at_r) = (x + l * sin, x - r * sin);
                    // Noise may put a point a little past the end of its flank.
                    let past = past(left, at_l).max(past(right, at_r));
                    if past > 0.003 || (x - x_near).abs() > HALF * self.pitch_m {
                        continue;
                    }
                    let cost = ((x - x_near) / 0.02).powi(2)
                        + ((psi - psi_near) / 0.05).powi(2)
                        + (past / 0.0007).powi(2);
                    if best.is_none_or(|b| cost < b.0) {
                        let from_corner_m = corner(left, at_l).min(corner(right, at_r));
                        best = Some((
                            cost,
                            ChainFix {
                                psi_s_rad: psi,
                                x_s_m: x,
                                from_corner_m,
                            },
                        ));
                    }
                }
            }
        }
        best.map(|b| b.1).ok_or(EstimatorFault::NoPlace {
            l_mm: l * 1e3,
            r_mm: r * 1e3,
            near_m: x_near,
        })
    }

    /// X_S at a given yaw from l and r (their mean), nearest to `near_m`; each side on its own flank.
    pub fn place_at_yaw(&self, crossing: &Crossing, psi_rad: f64, near_m: f64) -> Option<f64> {
        let (l, r) = crossing.half_widths_m("surge").ok()?;
        let (sin, cos) = psi_rad.sin_cos();
        let nearest = |half: f64, ahead: f64| {
            let places = self
                .flanks
                .iter()
                .map(|f| ((half * cos - f.a) / f.s, f))
                .filter(|(at, f)| past(f, *at) < 0.003);
            places
                .map(|(at, _)| at - ahead)
                .min_by(|a, b| (a - near_m).abs().total_cmp(&(b - near_m).abs()))
        };
        let (from_l, from_r) = (nearest(l, l * sin)?, nearest(r, -r * sin)?);
        Some(0.5 * (from_l + from_r))
    }

    /// Length of one hexagon along X \[m\].
    pub fn pitch_m(&self) -> f64 {
        self.pitch_m
    }
}

/// Distance of a place beyond a flank's ends \[m\].
fn past(flank: &Flank, x: f64) -> f64 {
    (flank.from_m - x).max(x - flank.to_m).max(0.0)
}

fn corner(flank: &Flank, x: f64) -> f64 {
    (x - flank.from_m).abs().min((flank.to_m - x).abs())
}

/// The yaws at which B lies on one flank and C on the other. X eliminated:
/// (r − s_r l / s_l) cos ψ + s_r (l + r) sin ψ = a_r − s_r a_l / s_l.
fn yaws(left: &Flank, right: &Flank, l: f64, r: f64) -> impl Iterator<Item = f64> {
    let ratio = right.s / left.s;
    let (p, q, c) = (r - ratio * l, right.s * (l + r), right.a - ratio * left.a);
    let size = p.hypot(q);
    let turn = q.atan2(p);
    let half = (c.abs() <= size).then(|| (c / size).acos());
    let wrap = |v: f64| {
        (v + std::f64::consts::PI).rem_euclid(2.0 * std::f64::consts::PI) - std::f64::consts::PI
    };
    half.into_iter()
        .flat_map(move |h| [wrap(turn + h), wrap(turn - h)])
}
