//! As much HTTP as the live page's tests need: one request, one answer.
#![allow(dead_code, clippy::unwrap_used)]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// An answer.
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub fn json(&self) -> serde_json::Value {
        serde_json::from_slice(&self.body).unwrap()
    }
}

/// A connection that is used again and again, as a browser's.
pub struct Viewer {
    address: SocketAddr,
    stream: TcpStream,
}

impl Viewer {
    pub fn new(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(20)))
            .unwrap();
        stream.set_nodelay(true).unwrap();
        Self { address, stream }
    }

    /// One request: the method and the path, and headers that end with a line break each.
    pub fn ask(&mut self, line: &str, headers: &str) -> Answer {
        self.try_ask(line, headers).unwrap()
    }

    /// The same; `None` when the server has closed.
    pub fn try_ask(&mut self, line: &str, headers: &str) -> Option<Answer> {
        let address = self.address;
        let request = format!("{line} HTTP/1.1\r\nHost: {address}\r\n{headers}\r\n");
        self.stream.write_all(request.as_bytes()).ok()?;
        let mut got = Vec::new();
        let mut some = [0; 16384];
        loop {
            if let Some(end) = got.windows(4).position(|w| w == b"\r\n\r\n") {
                let head = String::from_utf8_lossy(&got[..end]).to_ascii_lowercase();
                let length = head
                    .lines()
                    .find_map(|l| l.strip_prefix("content-length: "));
                let length: usize = length.map_or(0, |l| l.parse().unwrap());
                if got.len() >= end + 4 + length {
                    let status = head.split(' ').nth(1)?.parse().ok()?;
                    let body = got[end + 4..].to_vec();
                    return Some(Answer { status, head, body });
                }
            }
            match self.stream.read(&mut some) {
                Ok(0) | Err(_) => return None,
                Ok(n) => got.extend(&some[..n]),
            }
        }
    }
}

/// One request on a connection of its own.
pub fn ask(address: SocketAddr, line: &str, headers: &str) -> Answer {
    Viewer::new(address).ask(line, headers)
}

/// The session's key, as the page carries it.
pub fn session_key(address: SocketAddr) -> String {
    let page = ask(address, "GET /", "").text();
    let (_, rest) = page.split_once("name=\"session\" content=\"").unwrap();
    rest.split('"').next().unwrap().to_owned()
}

/// Overlay and image of a picture answer.
pub fn picture(answer: &Answer) -> (serde_json::Value, Vec<u8>) {
    let length = u32::from_le_bytes(answer.body[..4].try_into().unwrap()) as usize;
    let overlay = serde_json::from_slice(&answer.body[4..4 + length]).unwrap();
    (overlay, answer.body[4 + length..].to_vec())
}
