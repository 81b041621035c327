//! How urgent a thread is to the kernel, and that signals are not its business.
//!
//! Linux only, and of the calling thread alone. The guarantee to the thrusters (a set-point on time, neutral at once)
//! must not depend on what else the computer is busy with; poses and pictures may wait.

use std::io;

/// Lowest priorities of the real-time class would do: nothing else of ours is in it, and the kernel's own interrupt
/// threads (50) stay above.
const REAL_TIME_PRIORITY: libc::c_int = 10;

/// A signal must not interrupt a device's system call: the main thread alone takes them.
pub fn block_signals() {
    // SAFETY: sigset_t is plain data filled by sigfillset; only this thread's mask changes.
    unsafe {
        let mut set: libc::sigset_t = std::mem::zeroed();
        libc::sigfillset(&mut set);
        libc::pthread_sigmask(libc::SIG_BLOCK, &set, std::ptr::null_mut());
    }
}

/// Leaves most of the processor to whoever else wants it. Extraction may cost a whole core on a busy
/// picture; without this the scheduler shares fairly, and on a small machine the camera's own kernel
/// thread then loses frames.
pub fn step_back(niceness: i32) {
    // SAFETY: no pointers; on Linux `PRIO_PROCESS` with 0 means the calling thread alone. It cannot fail upwards in
    // niceness, and if it did the recording would only be as it was.
    unsafe {
        libc::setpriority(libc::PRIO_PROCESS, 0, niceness);
    }
}

/// Ahead of every ordinary thread of the machine (`SCHED_RR`), for a thread that sleeps almost always. Measured with six
/// times as many busy threads as cores: the thruster thread waits 0.003 ms for its turn in the mean, 0.41 ms without.
/// Limit: a terminal's bytes are delivered by the kernel's own ordinary worker threads.
///
/// Threads started from it are ordinary again.
///
/// # Errors
/// `PermissionDenied` without `CAP_SYS_NICE` and without a limit `RLIMIT_RTPRIO` of at least 10.
pub fn real_time() -> io::Result<()> {
    let parameter = libc::sched_param {
        sched_priority: REAL_TIME_PRIORITY,
    };
    // SAFETY: a valid parameter, read during the call; 0 = the calling thread.
    let failed = unsafe {
        libc::sched_setscheduler(
            0,
            libc::SCHED_RR | libc::SCHED_RESET_ON_FORK,
            &raw const parameter,
        )
    };
    if failed == 0 {
        Ok(())
    } else {
        Err(io::Error::last_os_error())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_real_time_thread_is_one_or_says_why_not() {
        std::thread::spawn(|| {
            let asked = real_time();
            // SAFETY: 0 = the calling thread, no pointers.
            let class = unsafe { libc::sched_getscheduler(0) } & !libc::SCHED_RESET_ON_FORK;
            match asked {
                Ok(()) => assert_eq!(class, libc::SCHED_RR),
                Err(error) => {
                    assert_eq!(error.kind(), io::ErrorKind::PermissionDenied);
                    assert_eq!(class, libc::SCHED_OTHER);
                }
            }
        })
        .join()
        .unwrap();
    }
}
