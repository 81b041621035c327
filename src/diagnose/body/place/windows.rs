//! Windows of time in which innovations are larger than noise, and larger than they are elsewhere.
//!
//! A model that lacks a law misses all the time, a little. What happens once (a carriage that stops, a touched wall) is found only
//! against that.

use hydroline_numerics::statistics::median;

/// Length over which innovations are summed \[s\].
const WINDOW_S: f64 = 0.5;
/// Excess of their squares, in its sd, above which a window is more than noise.
const BEYOND: f64 = 5.0;
/// Excess over what is usual in the DOF above which a window is said: twice the usual rms.
const CONCENTRATED: f64 = 4.0;
/// Windows that are said of a DOF, those with most of the misfit: more are no place.
const SAID: usize = 3;
/// Share of the misfit, and largest share of the time, of windows in which something happened once.
const EVENT: (f64, f64) = (0.5, 0.2);

/// Squared innovations of one half second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    run: usize,
    span_s: [f64; 2],
    /// Sum of squares beyond what noise makes, one per number.
    excess: f64,
    count: f64,
}

impl Cell {
    /// Excess per number.
    fn mean(&self) -> f64 {
        self.excess / self.count
    }

    fn is_beyond_noise(&self) -> bool {
        self.excess / (2.0 * self.count).sqrt() > BEYOND
    }
}

/// Half seconds of a run that hold any innovation (0 = not measured).
pub fn cells(run: usize, times_s: &[f64], white: &[[f64; 2]]) -> Vec<Cell> {
    let mut made = Vec::new();
    let mut first = 0;
    while first < times_s.len() {
        let from_s = times_s[first];
        let next = times_s
            .partition_point(|t| *t < from_s + WINDOW_S)
            .max(first + 1);
        let all = white[first..next].iter().flatten().filter(|v| **v != 0.0);
        let (energy, count) = all.fold((0.0, 0.0), |(e, n), v| (e + v * v, n + 1.0));
        if count > 0.0 {
            made.push(Cell {
                run,
                span_s: [from_s, times_s[next - 1]],
                excess: energy - count,
                count,
            });
        }
        first = next;
    }
    made
}

/// Window of one run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Place of the run.
    pub run: usize,
    /// From and to \[s since the log's first stamp\].
    pub span_s: [f64; 2],
    /// Share of the DOF's misfit in it.
    share: f64,
}

/// Windows of one DOF in all runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Windows {
    /// In the order of runs and time.
    pub all: Vec<Window>,
    /// The misfit is no larger in them than elsewhere: they are all that is more than noise.
    is_throughout: bool,
    /// Share of the time that is in them.
    time_share: f64,
}

impl Windows {
    /// Of a DOF's half seconds; `None` where none is more than noise.
    pub fn of(cells: &[Cell]) -> Option<Windows> {
        let usual = median(&mut cells.iter().map(Cell::mean).collect::<Vec<_>>())?.max(0.0);
        let beyond = || cells.iter().filter(|c| c.is_beyond_noise());
        let stands_out = |c: &&Cell| c.mean() > CONCENTRATED * usual;
        let is_throughout = !beyond().any(|c| stands_out(&c));
        let chosen = beyond().filter(|c| is_throughout || stands_out(c));
        let mut spans: Vec<(usize, Vec<[f64; 2]>)> = Vec::new();
        for c in chosen {
            match spans.last_mut().filter(|s| s.0 == c.run) {
                Some((_, of_run)) => merge(of_run, c.span_s),
                None => spans.push((c.run, vec![c.span_s])),
            }
        }
        let whole: f64 = cells.iter().map(|c| c.excess.max(0.0)).sum();
        let within = |run: usize, span_s: [f64; 2]| {
            let inside = move |c: &&Cell| {
                c.run == run && c.span_s[0] >= span_s[0] && c.span_s[1] <= span_s[1]
            };
            cells.iter().filter(inside)
        };
        let all: Vec<Window> = spans
            .into_iter()
            .flat_map(|(run, of_run)| of_run.into_iter().map(move |span_s| (run, span_s)))
            .map(|(run, span_s)| Window {
                run,
                span_s,
                share: within(run, span_s).map(|c| c.excess.max(0.0)).sum::<f64>() / whole,
            })
            .collect();
        let inside = all.iter().map(|w| within(w.run, w.span_s).count());
        let time_share = inside.sum::<usize>() as f64 / cells.len() as f64;
        (!all.is_empty()).then_some(Windows {
            all,
            is_throughout,
            time_share,
        })
    }

    /// Whether most of the misfit lies in a small part of the time.
    pub fn is_event(&self) -> bool {
        let share: f64 = self.all.iter().map(|w| w.share).sum();
        !self.is_throughout && share > EVENT.0 && self.time_share < EVENT.1
    }

    /// In words, with the windows that hold most of the misfit.
    pub fn words<'a>(&self, dof: &str, name: impl Fn(usize) -> &'a str) -> String {
        if self.is_throughout {
            return format!("in {dof} throughout");
        }
        let mut most = self.all.clone();
        most.sort_by(|a, b| b.share.total_cmp(&a.share));
        most.truncate(SAID);
        most.sort_by(|a, b| {
            (a.run, a.span_s[0])
                .partial_cmp(&(b.run, b.span_s[0]))
                .unwrap_or(std::cmp::Ordering::Equal)
        });
        let share: f64 = most.iter().map(|w| w.share).sum();
        let each: Vec<String> = most
            .iter()
            .map(|w| {
                let [from_s, to_s] = w.span_s;
                format!("{from_s:.1} to {to_s:.1} s of {}", name(w.run))
            })
            .collect();
        format!(
            "in {dof}, {:.0} % of the misfit at {}",
            100.0 * share,
            each.join(", ")
        )
    }
}

/// Puts a span into the spans of a run; what is less than a second apart is one.
pub fn merge(windows: &mut Vec<[f64; 2]>, new: [f64; 2]) {
    windows.push(new);
    windows.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut joined: Vec<[f64; 2]> = Vec::new();
    for w in windows.drain(..) {
        match joined.last_mut().filter(|l| w[0] - l[1] < 2.0 * WINDOW_S) {
            Some(last) => last[1] = last[1].max(w[1]),
            None => joined.push(w),
        }
    }
    *windows = joined;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Innovations of a swing that is missed by `rms` noise sds all the time, and by `after` from 78 s on, at 25 Hz from 26 s.
    fn swing(rms: f64, after: f64) -> (Vec<f64>, Vec<[f64; 2]>) {
        let times_s: Vec<f64> = (0..1475).map(|k| 26.0 + 0.04 * f64::from(k)).collect();
        let white = times_s.iter().enumerate().map(|(k, t)| {
            let noise = if k % 2 == 0 { 1.0 } else { -1.0 };
            let size = if *t < 78.0 { rms } else { after };
            [noise + size * 2f64.sqrt() * (2.46 * t).sin(), 0.0]
        });
        let white = white.collect();
        (times_s, white)
    }

    fn of(rms: f64, after: f64) -> Option<Windows> {
        let (times_s, white) = swing(rms, after);
        Windows::of(&cells(0, &times_s, &white))
    }

    /// A model that misses a swing by a little all the time hid the carriage's stop: one window held the whole run.
    #[test]
    fn a_stop_is_distinguished_from_a_swing_that_is_missed_all_the_time() {
        let found = of(5.0, 30.0).unwrap();
        assert_eq!(found.all.len(), 1, "{found:?}");
        let [from_s, to_s] = found.all[0].span_s;
        assert!((77.0..=78.0).contains(&from_s) && to_s > 84.0, "{found:?}");
        assert!(found.is_event());
        let words = found.words("roll", |_| "21340");
        assert!(words.starts_with("in roll, 8"), "{words}");
        assert!(words.contains(" to 85.0 s of 21340"), "{words}");
    }

    #[test]
    fn what_is_missed_all_the_time_has_no_place_and_noise_no_window() {
        let found = of(5.0, 5.0).unwrap();
        assert!(!found.is_event());
        assert_eq!(found.words("roll", |_| "21340"), "in roll throughout");
        assert_eq!(found.all.len(), 1, "{found:?}");
        assert!(of(0.0, 0.0).is_none());
    }

    #[test]
    fn beside_noise_alone_every_window_beyond_it_is_named() {
        let found = of(0.0, 3.0).unwrap();
        let words = found.words("roll", |_| "21340");
        assert!(words.contains("of the misfit at 78.0 to 85.0 s"), "{words}");
    }
}
