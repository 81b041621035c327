//! Logs for eyes: `LOGS="a.mcap b.mcap" cargo test -p hydroline-diagnose --lib -- --ignored --nocapture light_of_logs`.

use crate::profiles::level;
use hydroline_rigs::Rig;

#[test]
#[ignore = "for eyes"]
fn light_of_logs() {
    let rig = Rig::builtin("lshpi").unwrap();
    for log in std::env::var("LOGS").unwrap_or_default().split_whitespace() {
        let begun = std::time::Instant::now();
        let found = match level(&[log.into()], &rig, &|_| {}) {
            Ok(found) => found.unwrap(),
            Err(error) => {
                println!("{log}: {error}");
                continue;
            }
        };
        let seconds = begun.elapsed().as_secs_f64();
        println!(
            "{log}: {seconds:.1} s, {:?}, odds {:.0}: {}",
            found.word,
            found.log_odds,
            found.sentence()
        );
        for e in &found.effects {
            println!(
                "   {} p {:.4} {:?} {:?} or {:?}",
                e.effect, e.probability, e.parameters, e.words, e.or
            );
        }
        println!("   {:?} {:?}", found.equivalent, found.notes);
    }
}
