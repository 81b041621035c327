//! Frames that came and cannot be used, by cause.

use hydroline_capture::Excluded;

/// Numbers of frames that are kept in the log and left out of everything else.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Unusable {
    /// Frames that capture marks, by cause.
    pub marked: Excluded,
    /// Frames that nothing marks and that the analysis could not read. Those that it did not look at are not among them.
    pub damaged: u64,
}

impl Unusable {
    fn by_cause(&self) -> [(&'static str, u64); 5] {
        [
            ("flagged by the driver", self.marked.driver_error),
            ("cut short", self.marked.truncated),
            ("no whole JPEG", self.marked.broken_jpeg),
            ("damaged", self.damaged),
            ("stale", self.marked.stale),
        ]
    }

    /// Frames of which something was lost: all but stale ones.
    pub fn faulty(&self) -> u64 {
        let Excluded {
            driver_error,
            truncated,
            broken_jpeg,
            ..
        } = self.marked;
        driver_error + truncated + broken_jpeg + self.damaged
    }

    /// Numbers with their causes; `None` = there are none.
    pub fn words(&self) -> Option<String> {
        let words = self.by_cause().into_iter().filter(|(_, n)| *n > 0);
        let words: Vec<String> = words.map(|(cause, n)| format!("{n} {cause}")).collect();
        (!words.is_empty()).then(|| words.join(", "))
    }
}

/// Reason why a recording has no good frame, with what to do; `why` = what was said of the last unusable frame.
pub(super) fn no_good_frame(received: u64, unusable: &Unusable, why: Option<&str>) -> String {
    let Some(causes) = unusable.words() else {
        return match received {
            0 => "no good frame: is the camera plugged in and free?".to_owned(),
            _ => format!(
                "no good frame: {received} came and none has been looked at: is the computer too busy?"
            ),
        };
    };
    let last = why.map_or_else(String::new, |words| format!("; the last: {words}"));
    format!(
        "no good frame: {received} came and none can be used ({causes}){last}. Check the cable, or have the camera deliver another \
         camera.pixel_format;"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_came_and_why_they_cannot_be_used_are_said() {
        let none = Unusable::default();
        assert!(no_good_frame(0, &none, None).contains("plugged in"));
        assert!(no_good_frame(3, &none, None).contains("3 came"));
        let marked = Excluded {
            broken_jpeg: 85,
            stale: 2,
            ..Excluded::default()
        };
        let unusable = Unusable { marked, damaged: 3 };
        let why = "frame 86 is no whole JPEG: it does not begin with a start marker (ff d8)";
        let words = no_good_frame(90, &unusable, Some(why));
        for part in [
            "90 came",
            "85 no whole JPEG, 3 damaged, 2 stale",
            "start marker (ff d8)",
        ] {
            assert!(words.contains(part), "no '{part}' in: {words}");
        }
        assert!(!words.contains("plugged in"), "{words}");
    }

    #[test]
    fn stale_frames_are_no_loss_and_all_others_are() {
        let of = |marked: Excluded| Unusable { marked, damaged: 0 }.faulty();
        let none = Excluded::default();
        assert_eq!(of(Excluded { stale: 2, ..none }), 0);
        assert_eq!(
            of(Excluded {
                truncated: 1,
                ..none
            }),
            1
        );
        assert_eq!(
            of(Excluded {
                driver_error: 1,
                ..none
            }),
            1
        );
        assert_eq!(
            of(Excluded {
                broken_jpeg: 1,
                ..none
            }),
            1
        );
        assert_eq!(
            Unusable {
                marked: none,
                damaged: 1
            }
            .faulty(),
            1
        );
        assert_eq!(Unusable::default().words(), None);
    }
}
