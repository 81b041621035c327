//! Where the vehicle may be along a target that repeats itself, carried over frames without a pose.
//!
//! A frame shows x up to a whole number of repetitions. Each place that is possible is a hypothesis: a Kalman filter over
//! x, its rate and an acceleration that the model does not know (an Ornstein–Uhlenbeck process), driven by the commands
//! through the rig's inertia and drag. A pose splits each hypothesis into the repetitions near it, weighs them by how well they
//! were predicted, and so the motion decides, forwards (Bar-Shalom, Li and Kirubarajan 2001, chapter 11: multiple models with
//! pruning and merging). How much of the motion the model misses is not known either: every place has two hypotheses of it
//! ([`NOISES`]), and the run's own poses weigh them.

mod drive;

use drive::Drive;
use hydroline_rigs::Rig;
use nalgebra::{Matrix3, Vector3};

/// What is assumed of the motion that the model misses.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MotionNoise {
    /// Sd of the unknown acceleration \[m/s²\], and the share of the commanded one by which it is off (one sd).
    floor_mps2: f64,
    share: f64,
}

/// A vehicle that obeys its commands, thrust and drag known to a third; and one that anything pushes: a third of 0.2 m/s²,
/// three times what 16 N do to the paper's vehicle.
const NOISES: [MotionNoise; 2] = [
    MotionNoise {
        floor_mps2: 0.01,
        share: 0.3,
    },
    MotionNoise {
        floor_mps2: 0.067,
        share: 0.3,
    },
];
/// Correlation time of the unknown acceleration \[s\]: thrust steps and swell last for seconds.
const CORRELATION_S: f64 = 2.0;
/// Least weight of each of [`NOISES`]: a vehicle that has obeyed so far may be pushed next.
const NOISE_WEIGHT_LEAST: f64 = 0.02;
/// Sd of x at the start, as a share of the repetition: hands put a vehicle down within 6 cm of where the rig says (three sds).
const START_SHARE: f64 = 0.1;
/// The same on a target without repetitions \[m\].
const START_SD_M: f64 = 0.02;
/// Sd of the rate at the start \[m/s\]: at rest.
const START_RATE_MPS: f64 = 0.03;
/// Sd that the poses of a run share and that the filter adds to each one's own \[m\].
const SHARED_SD_M: f64 = 0.001;
/// Longest step of the prediction \[s\], and most steps of one.
const STEP_S: f64 = 0.1;
const STEPS_MOST: u32 = 600;
/// Repetitions within so many sds of a hypothesis are followed.
const GATE_SDS: f64 = 5.0;
/// An innovation beyond so many sds is an outlier: the pose counts as if it were that many sds off.
const OUTLIER_SDS: f64 = 5.0;
/// Hypotheses less probable than this are given up.
const PRUNED: f64 = 1e-6;
/// Hypotheses of one noise nearer than this share of the repetition are one place.
const SAME_SHARE: f64 = 0.25;
/// Probability from which on a place counts as decided.
const DECIDED: f64 = 0.99;
/// A pose may lie off the target's ends by this, steps there being off \[m\].
const BEYOND_END_M: f64 = 0.03;

/// A place along x, with its rate and unknown acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Hypothesis {
    noise: usize,
    mean: Vector3<f64>,
    covariance: Matrix3<f64>,
    weight: f64,
}

/// Where x is carried to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carried {
    /// Likeliest place \[m\].
    pub x_m: f64,
    /// Sd about it, other places left out \[m\].
    pub sd_m: f64,
    /// Probability of that place.
    pub probability: f64,
    /// Places that are followed.
    pub places: usize,
    /// Time since the last pose or the start \[s\].
    pub since_s: f64,
}

impl Carried {
    /// Whether the motion has decided between the places.
    pub fn is_decided(&self) -> bool {
        self.probability >= DECIDED
    }
}

impl std::fmt::Display for Carried {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "x is carried as {:.3} m (sd {:.0} mm) over {:.1} s: {} places are followed, the likeliest at {:.0} %; waits until \
             the motion, or the target's end, decides",
            self.x_m,
            1e3 * self.sd_m,
            self.since_s,
            self.places,
            100.0 * self.probability
        )
    }
}

/// A bank of places.
#[derive(Debug, Clone)]
pub struct Place {
    drive: Drive,
    period_m: Option<f64>,
    /// X of the target's ends, seen from the CG under the laser \[m\].
    x_range_m: [f64; 2],
    start_x_m: f64,
    at_ns: Option<u64>,
    psi_rad: f64,
    bank: Vec<Hypothesis>,
}

impl Place {
    /// Of a vehicle at rest where the rig says that it starts.
    pub fn new(rig: &Rig, period_m: Option<f64>, span_m: [f64; 2]) -> Self {
        let psi_rad = rig.tank.start_pose[5];
        let ahead_m = rig.mounts.l_laser_m * psi_rad.cos();
        let start_x_m = rig.tank.start_pose[0];
        let sd_m = period_m.map_or(START_SD_M, |p| START_SHARE * p);
        let bank = (0..NOISES.len()).map(|noise| Hypothesis {
            noise,
            mean: Vector3::new(start_x_m, 0.0, 0.0),
            covariance: Matrix3::from_diagonal(&Vector3::new(
                sd_m * sd_m,
                START_RATE_MPS.powi(2),
                NOISES[noise].floor_mps2.powi(2),
            )),
            weight: 1.0 / NOISES.len() as f64,
        });
        Place {
            drive: Drive::new(rig),
            period_m,
            x_range_m: [
                span_m[0] - ahead_m - BEYOND_END_M,
                span_m[1] - ahead_m + BEYOND_END_M,
            ],
            start_x_m,
            at_ns: None,
            psi_rad,
            bank: bank.collect(),
        }
    }

    /// Takes a command: thruster and thrust \[N\] that hold from a stamp on.
    pub fn command(&mut self, stamp_ns: u64, thruster: &str, thrust_n: f64) {
        self.drive.command(stamp_ns, thruster, thrust_n);
    }

    /// The run's first frame: until then the vehicle is at rest at the start.
    pub fn begin(&mut self, stamp_ns: u64) {
        self.at_ns.get_or_insert(stamp_ns);
    }

    /// Where the vehicle is at a stamp, as far as the poses before it say.
    pub fn carried(&self, stamp_ns: u64) -> Carried {
        let since_s = self
            .at_ns
            .map_or(0.0, |at| stamp_ns.saturating_sub(at) as f64 * 1e-9);
        summary(&self.predicted(stamp_ns), self.same_m(), since_s).unwrap_or(Carried {
            x_m: self.start_x_m,
            sd_m: f64::INFINITY,
            probability: 0.0,
            places: 0,
            since_s,
        })
    }

    /// Takes x of a pose, measured up to whole repetitions: where it lies now.
    pub fn update(&mut self, stamp_ns: u64, x_m: f64, variance_m2: f64, psi_rad: f64) -> Carried {
        let own_m2 = variance_m2 + SHARED_SD_M * SHARED_SD_M;
        let same_m = self.same_m();
        let since_s = self.carried(stamp_ns).since_s;
        let mut split: Vec<Hypothesis> = Vec::new();
        for before in &self.predicted(stamp_ns) {
            for place_m in self.places_m(x_m, before, own_m2) {
                split.extend(updated(before, place_m, own_m2));
            }
        }
        let sum: f64 = split.iter().map(|h| h.weight).sum();
        if sum > 0.0 && sum.is_finite() {
            split.iter_mut().for_each(|h| h.weight /= sum);
            split.retain(|h| h.weight > PRUNED);
            self.bank = merged(split, same_m);
            self.psi_rad = psi_rad;
            self.at_ns = Some(stamp_ns.max(self.at_ns.unwrap_or(0)));
        }
        summary(&self.bank, same_m, since_s).unwrap_or(self.carried(stamp_ns))
    }

    fn same_m(&self) -> f64 {
        self.period_m.map_or(f64::INFINITY, |p| SAME_SHARE * p)
    }

    /// Places of a pose near a hypothesis: the nearest, and all within the gate, as far as the target goes.
    fn places_m(&self, x_m: f64, near: &Hypothesis, own_m2: f64) -> Vec<f64> {
        let Some(period_m) = self.period_m else {
            return vec![x_m];
        };
        let reach_m = GATE_SDS * (near.covariance[(0, 0)] + own_m2).sqrt();
        let nearest = ((near.mean[0] - x_m) / period_m).round();
        let most = (reach_m / period_m).clamp(1.0, 100.0).ceil();
        let [first_m, last_m] = self.x_range_m;
        let place = |k: i32| x_m + (nearest + f64::from(k)) * period_m;
        let most = most as i32;
        let on_target = (-most..=most)
            .map(place)
            .filter(|p| *p == x_m || (first_m..=last_m).contains(p));
        let distance = |p: &f64| (p - near.mean[0]).abs();
        let mut places: Vec<f64> = on_target.collect();
        places.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        // The rival of the nearest one is always weighed.
        let within = places.iter().take_while(|p| distance(p) <= reach_m).count();
        places.truncate(within.max(2));
        places
    }

    /// The bank at a later stamp.
    fn predicted(&self, stamp_ns: u64) -> Vec<Hypothesis> {
        let mut bank = self.bank.clone();
        let Some(from_ns) = self.at_ns else {
            return bank;
        };
        let mut at_ns = from_ns;
        let mut commanded = self.drive.commanded_mps2(at_ns, self.psi_rad);
        let step_ns = (STEP_S * 1e9) as u64;
        let step_ns = step_ns.max(stamp_ns.saturating_sub(from_ns) / u64::from(STEPS_MOST));
        while at_ns < stamp_ns {
            let change_ns = self.drive.next_change_ns(at_ns).unwrap_or(stamp_ns);
            let to_ns = (at_ns + step_ns)
                .min(stamp_ns)
                .min(change_ns.max(at_ns + 1));
            let dt_s = (to_ns - at_ns) as f64 * 1e-9;
            for h in &mut bank {
                self.step(h, commanded, dt_s);
            }
            at_ns = to_ns;
            let now = self.drive.commanded_mps2(at_ns, self.psi_rad);
            if now != commanded {
                for h in &mut bank {
                    // The error of a command comes with it, at once.
                    let more = NOISES[h.noise].share * (now - commanded);
                    h.covariance[(2, 2)] += more * more;
                }
                commanded = now;
            }
        }
        bank
    }

    fn step(&self, h: &mut Hypothesis, commanded_mps2: f64, dt_s: f64) {
        let u = h.mean[1];
        let (drag, slope) = self.drive.drag_mps2(u);
        let kept = (-dt_s / CORRELATION_S).exp();
        // Implicit in the drag: a long step of a fast vehicle does not turn it round.
        let damped = 1.0 / (1.0 - (slope * dt_s).min(0.0));
        let gained = (commanded_mps2 + drag + h.mean[2]) * dt_s * damped;
        h.mean = Vector3::new(
            h.mean[0] + (u + 0.5 * gained) * dt_s,
            u + gained,
            h.mean[2] * kept,
        );
        #[rustfmt::skip]
        let by = Matrix3::new(
            1.0, dt_s, 0.5 * dt_s * dt_s,
            0.0, damped, dt_s * damped,
            0.0, 0.0, kept,
        );
        let noise = NOISES[h.noise];
        let sd2 = noise.floor_mps2.powi(2) + (noise.share * commanded_mps2).powi(2);
        let fresh = Vector3::new(dt_s * dt_s / 6.0, 0.5 * dt_s, 1.0);
        h.covariance = by * h.covariance * by.transpose()
            + fresh * fresh.transpose() * (sd2 * (1.0 - kept * kept));
    }
}

/// A hypothesis after a pose at a place, its weight by how well that was predicted.
fn updated(before: &Hypothesis, place_m: f64, own_m2: f64) -> Option<Hypothesis> {
    let off_m = place_m - before.mean[0];
    let honest_m2 = before.covariance[(0, 0)] + own_m2;
    let weight = before.weight * (-0.5 * off_m * off_m / honest_m2).exp() / honest_m2.sqrt();
    let outlier_m2 = (off_m / OUTLIER_SDS).powi(2) - before.covariance[(0, 0)];
    let own_m2 = own_m2.max(outlier_m2);
    let total_m2 = before.covariance[(0, 0)] + own_m2;
    let gain = before.covariance.column(0) / total_m2;
    let mut keep = Matrix3::identity();
    let of_x = keep.column(0) - gain;
    keep.set_column(0, &of_x);
    let covariance = keep * before.covariance * keep.transpose() + gain * gain.transpose() * own_m2;
    let after = Hypothesis {
        mean: before.mean + gain * off_m,
        covariance: 0.5 * (covariance + covariance.transpose()),
        weight: weight.max(f64::MIN_POSITIVE),
        ..*before
    };
    (after.mean.iter().all(|v| v.is_finite()) && after.weight.is_finite()).then_some(after)
}

/// Hypotheses of one noise at one place made one, by their moments; each noise keeps its least weight.
fn merged(mut all: Vec<Hypothesis>, same_m: f64) -> Vec<Hypothesis> {
    all.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    let mut out: Vec<Hypothesis> = Vec::new();
    for h in all {
        let same =
            |o: &&mut Hypothesis| o.noise == h.noise && (o.mean[0] - h.mean[0]).abs() < same_m;
        let Some(o) = out.iter_mut().find(same) else {
            out.push(h);
            continue;
        };
        let weight = o.weight + h.weight;
        let (a, b) = (o.weight / weight, h.weight / weight);
        let apart = o.mean - h.mean;
        o.covariance = o.covariance * a + h.covariance * b + apart * apart.transpose() * (a * b);
        o.mean = o.mean * a + h.mean * b;
        o.weight = weight;
    }
    for (noise, of) in NOISES.iter().enumerate() {
        let of_noise = |h: &&Hypothesis| h.noise == noise;
        let has: f64 = out.iter().filter(of_noise).map(|h| h.weight).sum();
        if has >= NOISE_WEIGHT_LEAST {
            continue;
        }
        // The other noise's places, as wide as this one makes them from here on.
        let mut own: Vec<Hypothesis> = out.iter().filter(|h| h.noise != noise).copied().collect();
        let others: f64 = own.iter().map(|h| h.weight).sum();
        for h in &mut own {
            h.noise = noise;
            h.weight *= NOISE_WEIGHT_LEAST / others;
            let floor = of.floor_mps2.powi(2);
            h.covariance[(2, 2)] = h.covariance[(2, 2)].max(floor);
        }
        out.retain(|h| h.noise != noise);
        out.iter_mut()
            .for_each(|h| h.weight *= 1.0 - NOISE_WEIGHT_LEAST);
        out.extend(own);
    }
    let sum: f64 = out.iter().map(|h| h.weight).sum();
    out.iter_mut().for_each(|h| h.weight /= sum);
    out
}

/// The likeliest place of a bank; `None` for an empty one.
fn summary(bank: &[Hypothesis], same_m: f64, since_s: f64) -> Option<Carried> {
    let best = bank.iter().max_by(|a, b| a.weight.total_cmp(&b.weight))?;
    let here = |h: &&Hypothesis| (h.mean[0] - best.mean[0]).abs() < same_m;
    let all: f64 = bank.iter().map(|h| h.weight).sum();
    let weight: f64 = bank.iter().filter(here).map(|h| h.weight).sum();
    let of = |f: &dyn Fn(&Hypothesis) -> f64| {
        bank.iter()
            .filter(here)
            .map(|h| h.weight * f(h))
            .sum::<f64>()
            / weight
    };
    let x_m = of(&|h| h.mean[0]);
    let variance = of(&|h| h.covariance[(0, 0)] + (h.mean[0] - x_m).powi(2));
    let mut places: Vec<f64> = Vec::new();
    for h in bank {
        if places.iter().all(|p| (h.mean[0] - p).abs() >= same_m) {
            places.push(h.mean[0]);
        }
    }
    Some(Carried {
        x_m,
        sd_m: variance.max(0.0).sqrt(),
        probability: weight / all,
        places: places.len(),
        since_s,
    })
}

#[cfg(test)]
mod tests;
