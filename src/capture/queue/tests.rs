//! Against a model of videobuf2: it panics on every call that the real one would punish.

use proptest::prelude::*;

use super::*;

const MS: u64 = 1_000_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Vb2 {
    Dequeued,
    Queued,
    Done { void: bool },
}

/// Events that the world puts to the queue, in turn.
#[derive(Debug, Clone, Copy)]
enum Fault {
    Frame,
    Silence(u64),
    Interrupt,
    Spurious,
    RefuseEnqueue,
    RefuseStreamOn,
    Fatal,
    VoidAll,
    ErrorFrame,
    Unplug,
}

struct Kernel {
    buffers: Vec<Vb2>,
    done: std::collections::VecDeque<u32>,
    streaming: bool,
    error: bool,
    gone: bool,
    interrupt: bool,
    spurious: bool,
    refuse_enqueue: bool,
    refuse_stream_on: bool,
}

impl Kernel {
    fn new(n: u32) -> Self {
        Self {
            buffers: vec![Vb2::Dequeued; n as usize],
            done: Default::default(),
            streaming: false,
            error: false,
            gone: false,
            interrupt: false,
            spurious: false,
            refuse_enqueue: false,
            refuse_stream_on: false,
        }
    }

    fn finish_one(&mut self, void: bool) {
        if !self.streaming || self.error {
            return;
        }
        if let Some(i) = self.buffers.iter().position(|b| *b == Vb2::Queued) {
            self.buffers[i] = Vb2::Done { void };
            self.done.push_back(i as u32);
        }
    }

    fn strike(&mut self, fault: Fault) {
        match fault {
            Fault::Frame | Fault::ErrorFrame => self.finish_one(false),
            Fault::Silence(_) => {}
            Fault::Interrupt => self.interrupt = true,
            Fault::Spurious => self.spurious = true,
            Fault::RefuseEnqueue => self.refuse_enqueue = true,
            Fault::RefuseStreamOn => self.refuse_stream_on = true,
            Fault::Fatal => self.error = self.streaming,
            Fault::VoidAll => (0..self.buffers.len()).for_each(|_| self.finish_one(true)),
            Fault::Unplug => self.gone = true,
        }
    }

    /// Performs the call; `now` moves on by what it takes.
    fn perform(&mut self, action: Action, now: &mut u64) -> Outcome {
        *now += 1000;
        if let Action::Rest { until_ns } = action {
            *now = (*now).max(until_ns);
            return Outcome::Done;
        }
        if let Action::Deliver(i) = action {
            assert_eq!(
                self.buffers[i as usize],
                Vb2::Dequeued,
                "reading a buffer that the kernel owns"
            );
            return Outcome::Done;
        }
        if std::mem::take(&mut self.interrupt) {
            return Outcome::Failed(libc::EINTR);
        }
        if self.gone {
            return if matches!(action, Action::Poll { .. }) {
                Outcome::Ready
            } else {
                Outcome::Failed(libc::ENODEV)
            };
        }
        match action {
            Action::Enqueue(i) => {
                assert_eq!(
                    self.buffers[i as usize],
                    Vb2::Dequeued,
                    "queueing a buffer that the kernel owns"
                );
                if self.error {
                    return Outcome::Failed(libc::EIO);
                }
                if std::mem::take(&mut self.refuse_enqueue) {
                    return Outcome::Failed(libc::EINVAL);
                }
                self.buffers[i as usize] = Vb2::Queued;
                Outcome::Done
            }
            Action::StreamOn => {
                assert!(
                    self.buffers.contains(&Vb2::Queued),
                    "STREAMON without a buffer"
                );
                assert!(!self.streaming, "STREAMON twice");
                if std::mem::take(&mut self.refuse_stream_on) {
                    return Outcome::Failed(libc::EINVAL);
                }
                self.streaming = true;
                Outcome::Done
            }
            Action::StreamOff => {
                self.buffers.fill(Vb2::Dequeued);
                self.done.clear();
                (self.streaming, self.error) = (false, false);
                Outcome::Done
            }
            Action::Poll { until_ns } => {
                if std::mem::take(&mut self.spurious)
                    || !self.done.is_empty()
                    || self.error
                    || !self.streaming
                {
                    return Outcome::Ready;
                }
                // A poll with nothing to come lasts until its deadline, or as long as the adapter's caller waits.
                *now = (*now + 20 * MS).min(until_ns.max(*now));
                Outcome::Silence
            }
            Action::Dequeue => {
                if self.error {
                    return Outcome::Failed(libc::EIO);
                }
                if !self.streaming {
                    return Outcome::Failed(libc::EINVAL);
                }
                match self.done.pop_front() {
                    None => Outcome::Failed(libc::EAGAIN),
                    Some(index) => {
                        let void = self.buffers[index as usize] == (Vb2::Done { void: true });
                        self.buffers[index as usize] = Vb2::Dequeued;
                        Outcome::Dequeued { index, void }
                    }
                }
            }
            Action::Rest { .. } | Action::Deliver(_) | Action::Reopen => Outcome::Done,
        }
    }
}

struct Bench {
    queue: BufferQueue,
    kernel: Kernel,
    now: u64,
    delivered: usize,
    notices: Vec<Notice>,
}

impl Bench {
    fn new(buffers: u32) -> Self {
        let queue = BufferQueue::new(buffers, Patience::default(), 0);
        Self {
            queue,
            kernel: Kernel::new(buffers),
            now: 0,
            delivered: 0,
            notices: Vec::new(),
        }
    }

    fn step(&mut self) -> Action {
        let action = self.queue.action(self.now);
        assert_eq!(
            action,
            self.queue.action(self.now),
            "asking must not change anything"
        );
        let outcome = self.kernel.perform(action, &mut self.now);
        self.delivered += usize::from(matches!(action, Action::Deliver(_)));
        self.notices
            .extend(self.queue.outcome(action, outcome, self.now));
        // No buffer is ever lost: those the queue thinks are the kernel's are the kernel's.
        let kernels = self
            .kernel
            .buffers
            .iter()
            .filter(|b| **b != Vb2::Dequeued)
            .count();
        let owners = self.queue.owners.iter();
        let queued = owners.filter(|o| **o == Owner::Kernel).count();
        assert_eq!(queued, kernels, "after {action:?} -> {outcome:?}");
        action
    }

    /// Steps until frames flow; fails if they do not within 10 simulated seconds or 20000 steps.
    fn flows(&mut self) -> bool {
        let (until, had) = (self.now + 10_000 * MS, self.delivered);
        for _ in 0..20_000 {
            if self.step() == Action::Reopen || self.now > until {
                return false;
            }
            self.kernel.finish_one(false);
            if self.delivered > had + 20 {
                return true;
            }
        }
        false
    }
}

#[test]
fn starts_fills_and_flows() {
    let mut bench = Bench::new(8);
    assert!(bench.flows());
    assert_eq!(bench.notices, [Notice::Started]);
}

#[test]
fn a_frozen_camera_is_noticed_and_restarted_with_growing_patience() {
    let mut bench = Bench::new(4);
    assert!(bench.flows());
    bench.kernel.done.clear();
    let start = bench.now;
    while bench.now < start + 20_000 * MS {
        bench.step();
    }
    let frozen: Vec<_> = bench
        .notices
        .iter()
        .filter(|n| matches!(n, Notice::Frozen { .. }))
        .collect();
    assert!((4..=8).contains(&frozen.len()), "{frozen:?}");
    assert!(matches!(
        frozen[0],
        Notice::Frozen {
            silence_ns: 1_000_000_000..=1_100_000_000,
            attempt: 1
        }
    ));
    assert!(bench.flows(), "goes on when the camera does");
}

#[test]
fn a_fatal_error_backs_off_and_does_not_spin() {
    let mut bench = Bench::new(4);
    assert!(bench.flows());
    let (mut calls, start) = (0, bench.now);
    while bench.now < start + 5_000 * MS {
        if bench.step() == Action::StreamOn {
            bench.kernel.strike(Fault::Fatal);
        }
        bench.kernel.error |= bench.kernel.streaming;
        calls += 1;
    }
    assert!(calls < 200, "{calls} calls in 5 s");
    bench.kernel.error = false;
    assert!(bench.flows());
}

/// c-uvc of tests/hil on a busy host: the endpoint halts in the middle of a frame, or while whole frames wait to be
/// fetched. Those come first, as frames, and are queued again, so that never as many voids follow as there are buffers.
#[test]
fn a_stream_given_up_in_the_middle_of_a_frame_is_restarted() {
    for frames in 1..8u32 {
        let patience = Patience::default();
        let mut queue = BufferQueue::new(8, patience, 0);
        let mut now_ns = 0;
        let mut handed_out = (0..8u32).map(|i| (i, i >= frames));
        let mut notices = Vec::new();
        while now_ns < 900 * MS && notices.last() != Some(&Notice::Voided) {
            now_ns += MS;
            let action = queue.action(now_ns);
            let outcome = match action {
                // All eight at once, then silence for ever.
                Action::Poll { .. } if handed_out.len() > 0 => Outcome::Ready,
                Action::Poll { .. } => Outcome::Silence,
                Action::Dequeue => {
                    let (index, void) = handed_out.next().unwrap();
                    Outcome::Dequeued { index, void }
                }
                _ => Outcome::Done,
            };
            notices.extend(queue.outcome(action, outcome, now_ns));
        }
        assert_eq!(
            notices,
            [Notice::Started, Notice::Voided],
            "{frames} frames first"
        );
        assert!(now_ns < 600 * MS, "{now_ns}");
    }
}

#[test]
fn one_void_buffer_in_a_running_stream_is_no_end() {
    let mut queue = BufferQueue::new(4, Patience::default(), 0);
    let mut dequeued = 0u32;
    for step in 1..2000u64 {
        let now_ns = step * 10 * MS;
        let action = queue.action(now_ns);
        let outcome = match action {
            Action::Poll { .. } => Outcome::Ready,
            Action::Dequeue => {
                dequeued += 1;
                let index = (0..4).find(|i| queue.owners[*i] == Owner::Kernel).unwrap() as u32;
                // Every tenth is void.
                Outcome::Dequeued {
                    index,
                    void: dequeued.is_multiple_of(10),
                }
            }
            _ => Outcome::Done,
        };
        let notice = queue.outcome(action, outcome, now_ns);
        assert!(matches!(notice, None | Some(Notice::Started)), "{notice:?}");
    }
    assert!(dequeued > 100);
}

#[test]
fn eight_void_buffers_restart_the_stream() {
    let mut bench = Bench::new(8);
    assert!(bench.flows());
    for _ in 0..40 {
        bench.step();
    }
    bench.kernel.strike(Fault::VoidAll);
    while !bench.notices.contains(&Notice::Voided) {
        bench.step();
    }
    assert!(bench.flows());
}

#[test]
fn a_driver_that_wakes_for_nothing_does_not_cost_a_core() {
    let mut bench = Bench::new(4);
    assert!(bench.flows());
    let (mut calls, start) = (0, bench.now);
    while bench.now < start + 900 * MS {
        bench.kernel.strike(Fault::Spurious);
        bench.step();
        calls += 1;
    }
    assert!(calls < 2000, "{calls} calls in 0.9 s");
}

#[test]
fn a_buffer_the_kernel_did_not_have_restarts() {
    for index in [0, 7, u32::MAX] {
        let mut queue = BufferQueue::new(2, Patience::default(), 0);
        queue.set(0, Owner::Held);
        queue.phase = Phase::Streaming { ready: true };
        let notice = queue.outcome(Action::Dequeue, Outcome::Dequeued { index, void: false }, 0);
        assert_eq!(notice, Some(Notice::Nonsense { index }));
        assert_eq!(queue.action(0), Action::StreamOff);
    }
}

fn fault() -> impl Strategy<Value = Fault> {
    prop_oneof![
        8 => Just(Fault::Frame),
        2 => (1u64..3000).prop_map(Fault::Silence),
        3 => Just(Fault::Interrupt),
        2 => Just(Fault::Spurious),
        2 => Just(Fault::RefuseEnqueue),
        1 => Just(Fault::RefuseStreamOn),
        1 => Just(Fault::Fatal),
        1 => Just(Fault::VoidAll),
        1 => Just(Fault::ErrorFrame),
    ]
}

proptest! {
    /// After any history of timeouts, signals, refusals and errors: no call that the kernel would punish,
    /// no buffer lost, and frames flow again once the faults stop.
    #[test]
    fn no_history_wedges_the_queue(
        buffers in 1u32..9,
        history in proptest::collection::vec((fault(), 0usize..12), 0..120),
    ) {
        let mut bench = Bench::new(buffers);
        for (fault, steps) in history {
            bench.kernel.strike(fault);
            if let Fault::Silence(ms) = fault {
                let until = bench.now + ms * MS;
                while bench.now < until { bench.step(); }
            }
            for _ in 0..steps { bench.step(); }
        }
        prop_assert!(bench.flows(), "stuck: {:?}", bench.queue);
    }

    /// A pulled device is noticed within a few calls, whatever was going on.
    #[test]
    fn a_pulled_device_is_noticed(
        buffers in 1u32..9,
        history in proptest::collection::vec((fault(), 0usize..12), 0..40),
    ) {
        let mut bench = Bench::new(buffers);
        for (fault, steps) in history {
            bench.kernel.strike(fault);
            for _ in 0..steps { bench.step(); }
        }
        bench.kernel.strike(Fault::Unplug);
        let gone = (0..40).any(|_| {
            let action = bench.queue.action(bench.now);
            let outcome = bench.kernel.perform(action, &mut bench.now);
            bench.queue.outcome(action, outcome, bench.now);
            bench.queue.action(bench.now) == Action::Reopen
        });
        prop_assert!(gone, "{:?}", bench.queue);
    }
}
