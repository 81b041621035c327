//! Secrets: the token that opens the page off this computer, and the key that the page carries for STOP.

use super::address::LiveError;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read};

/// Shortest token: 16 characters out of 64 are 96 bits when drawn at random.
pub const TOKEN_MIN: usize = 16;
/// Longest token.
pub const TOKEN_MAX: usize = 128;

/// A secret that is only ever compared. Not shown by `Debug`.
#[derive(Clone)]
pub struct Token {
    text: String,
    digest: [u8; 32],
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(..)")
    }
}

impl Token {
    /// A token that a person chose.
    ///
    /// # Errors
    /// [`LiveError::Token`] when it is too short, too long, or would have to be escaped in an address.
    pub fn chosen(text: &str) -> Result<Self, LiveError> {
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if !(TOKEN_MIN..=TOKEN_MAX).contains(&text.len()) || !text.chars().all(plain) {
            return Err(LiveError::Token {
                length: text.chars().count(),
                example: random_hex(16)?,
            });
        }
        Ok(Self::new(text.to_owned()))
    }

    /// A token of 128 random bits.
    ///
    /// # Errors
    /// When the kernel gives no randomness.
    pub fn random() -> io::Result<Self> {
        Ok(Self::new(random_hex(16)?))
    }

    fn new(text: String) -> Self {
        let digest = Sha256::digest(text.as_bytes()).into();
        Self { text, digest }
    }

    /// The secret itself, for the one place that has to hand it on.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Whether `offered` is the secret, in a time that does not depend on how much of it is right: digests of equal
    /// length are compared, and all of their bytes.
    pub fn is(&self, offered: &str) -> bool {
        let offered: [u8; 32] = Sha256::digest(offered.as_bytes()).into();
        let differing = self
            .digest
            .iter()
            .zip(&offered)
            .fold(0u8, |all, (a, b)| std::hint::black_box(all | (a ^ b)));
        differing == 0
    }
}

/// So many random bytes from the kernel, in hexadecimal.
///
/// # Errors
/// When the kernel gives none.
pub fn random_hex(bytes: usize) -> io::Result<String> {
    let mut random = vec![0; bytes];
    File::open("/dev/urandom")?.read_exact(&mut random)?;
    Ok(random.iter().map(|b| format!("{b:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_token_that_could_be_guessed_is_refused_with_one_that_would_do() {
        for bad in [
            "",
            "hydroline",
            "short-by-one-12",
            "sixteen chars...",
            "ääääääääääääääää",
        ] {
            let words = Token::chosen(bad).unwrap_err().to_string();
            let example = words.rsplit(' ').next().unwrap();
            assert!(Token::chosen(example).is_ok(), "{words}");
        }
        assert!(Token::chosen(&"a".repeat(129)).is_err());
    }

    #[test]
    fn no_two_are_alike_and_none_is_shown() {
        let (a, b) = (Token::random().unwrap(), Token::random().unwrap());
        assert!(a.is(a.text()) && !a.is(b.text()));
        assert!(!format!("{a:?}").contains(a.text()));
    }

    proptest! {
        #[test]
        fn only_the_secret_itself_is_the_secret(offered in ".*", cut in 0usize..32) {
            let token = Token::random().unwrap();
            prop_assert!(!token.is(&offered));
            let part: String = token.text().chars().take(cut).collect();
            prop_assert!(!token.is(&part));
        }
    }
}
