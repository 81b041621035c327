//! Between whoever publishes and whoever looks: the newest state, the newest picture, and STOP.
//!
//! Publishing replaces a value and wakes whoever waits for it; it never waits for them. Neither the capture thread nor
//! the thruster service publishes here: what they know is fetched from them by a thread that nobody waits for.

use super::picture::Picture;
use super::state::State;
use hydroline_core::lock::Lock;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tokio::sync::watch;

/// A value with its number: the next one has a greater one, also after the program was started again.
#[derive(Debug)]
pub struct Numbered<T> {
    /// Grows with each value.
    pub number: u64,
    /// `None` before the first.
    pub value: Option<Arc<T>>,
}

impl<T> Clone for Numbered<T> {
    fn clone(&self) -> Self {
        Self {
            number: self.number,
            value: self.value.clone(),
        }
    }
}

/// Brings the thrusters to neutral. Called on the server's thread; must not wait.
pub type StopLine = Box<dyn Fn() + Send + Sync>;

/// State, pictures and STOP, which runs and viewers share.
pub struct Feed {
    states: watch::Sender<Numbered<State>>,
    pictures: watch::Sender<Numbered<Picture>>,
    began: Instant,
    /// When somebody last asked for a picture \[ms since `began`\]; 0 = never.
    looked_ms: AtomicU64,
    pressed: AtomicBool,
    stops: AtomicBool,
    line: Mutex<Option<StopLine>>,
}

impl std::fmt::Debug for Feed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Feed")
            .field("pressed", &self.pressed)
            .finish_non_exhaustive()
    }
}

impl Default for Feed {
    fn default() -> Self {
        Self::new(false)
    }
}

/// Pictures are made while somebody has asked for one within this time.
const LOOKING: Duration = Duration::from_secs(2);

impl Feed {
    /// `stops` = there are thrusters that STOP can bring to neutral, now or later.
    pub fn new(stops: bool) -> Self {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH);
        let number = unix.map_or(1, |d| d.as_millis() as u64);
        Self {
            states: watch::Sender::new(Numbered {
                number,
                value: None,
            }),
            pictures: watch::Sender::new(Numbered {
                number,
                value: None,
            }),
            began: Instant::now(),
            looked_ms: AtomicU64::new(0),
            pressed: AtomicBool::new(false),
            stops: AtomicBool::new(stops),
            line: Mutex::new(None),
        }
    }

    /// Replaces the state. What STOP is and whether it was pressed is filled in here.
    pub fn publish(&self, mut state: State) {
        state.stop.possible = self.stops.load(Ordering::Acquire);
        state.stop.pressed = self.pressed();
        replace(&self.states, state);
    }

    /// Replaces the picture.
    pub fn show(&self, picture: Picture) {
        replace(&self.pictures, picture);
    }

    /// To wait for states.
    pub fn states(&self) -> watch::Receiver<Numbered<State>> {
        self.states.subscribe()
    }

    /// To wait for pictures; says that somebody looks.
    pub fn pictures(&self) -> watch::Receiver<Numbered<Picture>> {
        let now_ms = self.began.elapsed().as_millis() as u64;
        self.looked_ms.store(now_ms.max(1), Ordering::Relaxed);
        self.pictures.subscribe()
    }

    /// Whether somebody looks: without anyone no picture need be made.
    pub fn is_watched(&self) -> bool {
        let looked_ms = self.looked_ms.load(Ordering::Relaxed);
        let now_ms = self.began.elapsed().as_millis() as u64;
        looked_ms > 0 && now_ms.saturating_sub(looked_ms) <= LOOKING.as_millis() as u64
    }

    /// From now on STOP brings this line to neutral. Pressed before: at once.
    pub fn attach(&self, line: StopLine) {
        let mut slot = self.line.held();
        if self.pressed() {
            line();
        }
        *slot = Some(line);
    }

    /// The line is closed.
    pub fn detach(&self) {
        *self.line.held() = None;
    }

    /// STOP. False when there is nothing to stop and never will be.
    pub fn press(&self) -> bool {
        if !self.stops.load(Ordering::Acquire) {
            return false;
        }
        // First the flag: a line that is attached meanwhile sees it.
        self.pressed.store(true, Ordering::Release);
        if let Some(line) = &*self.line.held() {
            line();
        }
        true
    }

    /// Whether STOP was pressed: for good, as for every run that would follow.
    pub fn pressed(&self) -> bool {
        self.pressed.load(Ordering::Acquire)
    }
}

fn replace<T>(to: &watch::Sender<Numbered<T>>, value: T) {
    let value = Some(Arc::new(value));
    to.send_modify(|newest| {
        newest.number += 1;
        newest.value = value;
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicU32;

    #[test]
    fn the_newest_wins_and_numbers_grow() {
        let feed = Feed::default();
        let seen = feed.states();
        let first = seen.borrow().number;
        for k in 0..5 {
            feed.publish(State {
                phase: k.to_string(),
                ..State::default()
            });
        }
        let newest = seen.borrow().clone();
        assert_eq!(newest.number, first + 5);
        assert_eq!(newest.value.unwrap().phase, "4");
    }

    #[test]
    fn nobody_looks_until_a_picture_is_asked_for() {
        let feed = Feed::default();
        let _states = feed.states();
        assert!(!feed.is_watched());
        let _pictures = feed.pictures();
        assert!(feed.is_watched());
    }

    #[test]
    fn a_stop_before_the_thrusters_are_there_holds_for_them() {
        let feed = Feed::new(true);
        let stopped = Arc::new(AtomicU32::new(0));
        let line = |n: &Arc<AtomicU32>| -> StopLine {
            let n = n.clone();
            Box::new(move || {
                n.fetch_add(1, Ordering::Relaxed);
            })
        };
        feed.attach(line(&stopped));
        assert_eq!(stopped.load(Ordering::Relaxed), 0);
        assert!(feed.press());
        assert_eq!(stopped.load(Ordering::Relaxed), 1);
        feed.detach();
        assert!(feed.press());
        // The next run's line.
        feed.attach(line(&stopped));
        assert_eq!(stopped.load(Ordering::Relaxed), 2);
        assert!(feed.pressed());
    }

    #[test]
    fn without_thrusters_there_is_no_stop() {
        let feed = Feed::new(false);
        assert!(!feed.press() && !feed.pressed());
    }
}
