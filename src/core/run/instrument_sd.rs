//! Noise that whoever imported a log states of its instruments.

use std::collections::BTreeMap;

use super::{Channel, PerChannel};

/// Keys of a log's session that state it, each followed by the channel's name \[SI\].
const PREFIX: &str = "import.sd.";

/// Entry of a log's session that states the sd of a channel's instrument \[SI\].
pub fn entry(channel: Channel, sd: f64) -> (String, String) {
    (format!("{PREFIX}{}", channel.name()), sd.to_string())
}

/// Entries of a session that state it, to be carried into another log of the same motion.
pub fn entries(session: &BTreeMap<String, String>) -> impl Iterator<Item = (String, String)> {
    let own = session.iter().filter(|(key, _)| key.starts_with(PREFIX));
    own.map(|(key, value)| (key.clone(), value.clone()))
}

/// Least noise of each channel as a log's session states it \[SI\]; 0 = it states none.
pub fn of_session(session: &BTreeMap<String, String>) -> PerChannel<f64> {
    PerChannel::from_fn(|c| {
        let own = session.get(&format!("{PREFIX}{}", c.name()));
        let sd = own.and_then(|v| v.parse::<f64>().ok());
        sd.filter(|v| v.is_finite() && *v > 0.0).unwrap_or(0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_gives_back_the_sds_that_it_states_and_nothing_else() {
        let mut session: BTreeMap<String, String> =
            [entry(Channel::X, 1e-3), entry(Channel::R, 2.5e-3)].into();
        session.insert("kind".to_owned(), "import".to_owned());
        session.insert("import.sd.psi_rad".to_owned(), "-1".to_owned());
        session.insert("import.sd.u_mps".to_owned(), "none".to_owned());
        let found = of_session(&session);
        assert_eq!((found[Channel::X], found[Channel::R]), (1e-3, 2.5e-3));
        assert_eq!(found.iter().filter(|v| **v > 0.0).count(), 2);
        let carried: BTreeMap<String, String> = entries(&session).collect();
        assert_eq!(of_session(&carried), found);
    }
}
