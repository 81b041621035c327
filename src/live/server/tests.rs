//! The server on a real socket, with a client that knows no more HTTP than it needs.

use super::super::picture::{Overlay, Picture};
use super::super::places::{KEPT_PER_PEER, WAITING_MAX};
use super::super::state::State;
use super::*;
use bytes::Bytes;
use hydroline_core::frame::{
    Frame, FrameMeta, GreyRule, LossBefore, PixelFormat, StampClock, StampSource,
};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

const TOKEN: &str = "a-token-for-tests-0123";

struct Answer {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Answer {
    fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }
}

fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    stream
}

/// Sends bytes as they are and reads until the server closes, or one whole answer.
fn exchange(address: SocketAddr, request: &[u8]) -> Option<Answer> {
    let mut stream = connect(address);
    // A server that has closed already has answered all it will.
    let _ = stream.write_all(request);
    let mut got = Vec::new();
    let mut some = [0; 4096];
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
        match stream.read(&mut some) {
            Ok(0) | Err(_) => return None,
            Ok(n) => got.extend(&some[..n]),
        }
    }
}

fn ask(address: SocketAddr, line: &str, headers: &str) -> Answer {
    let request = format!("{line} HTTP/1.1\r\nHost: {address}\r\n{headers}\r\n");
    exchange(address, request.as_bytes()).unwrap()
}

fn picture(sequence: u32) -> Picture {
    Picture {
        frame: Frame {
            format: PixelFormat::Grey,
            width_px: 64,
            height_px: 48,
            stride_bytes: 64,
            data: Bytes::from(vec![90; 64 * 48]),
            meta: FrameMeta {
                sequence,
                driver_stamp_ns: 0,
                stamp_clock: StampClock::Realtime,
                stamp_source: StampSource::MidExposure,
                flags: 0,
                received_monotonic_ns: 0,
                mid_exposure_ns: 0,
                exposure_s: 0.0,
                fault: None,
                lost_before: LossBefore::default(),
            },
        },
        rule: GreyRule::default(),
        overlay: Overlay {
            sequence,
            width_px: 64,
            height_px: 48,
            ..Overlay::default()
        },
    }
}

fn started(token: Option<&str>) -> (Server, Arc<Feed>, Arc<AtomicU32>) {
    let feed = Arc::new(Feed::new(true));
    let stops = Arc::new(AtomicU32::new(0));
    let counted = stops.clone();
    feed.attach(Box::new(move || {
        counted.fetch_add(1, Ordering::SeqCst);
    }));
    feed.publish(State {
        title: "secret-rig".to_owned(),
        ..State::default()
    });
    feed.show(picture(7));
    let token = token.map(|t| Token::chosen(t).unwrap());
    let address = "127.0.0.1:0".parse().unwrap();
    let server = Server::start(address, token, feed.clone()).unwrap();
    (server, feed, stops)
}

/// The session's key, as the page has it.
fn key(page: &str) -> String {
    let (_, rest) = page.split_once("name=\"session\" content=\"").unwrap();
    rest.split('"').next().unwrap().to_owned()
}

#[test]
fn page_state_picture_and_metrics_are_there() {
    let (server, _feed, _) = started(None);
    let page = ask(server.address(), "GET /", "");
    assert_eq!(page.status, 200);
    assert!(
        page.head
            .contains("content-security-policy: default-src 'none'; script-src 'nonce-")
    );
    assert!(page.head.contains("x-frame-options: deny") && page.head.contains("no-store"));
    let state = ask(server.address(), "GET /state?after=0", "");
    let json: serde_json::Value = serde_json::from_slice(&state.body).unwrap();
    assert_eq!(json["state"]["title"], "secret-rig");
    assert_eq!(json["state"]["stop"]["possible"], true);
    // Nothing newer: an empty answer, in good time.
    let line = format!("GET /state?after={}", json["number"]);
    assert_eq!(ask(server.address(), &line, "").status, 204);
    let picture = ask(server.address(), "GET /picture", "");
    let length = u32::from_le_bytes(picture.body[..4].try_into().unwrap()) as usize;
    let overlay: serde_json::Value = serde_json::from_slice(&picture.body[4..4 + length]).unwrap();
    assert_eq!(overlay["sequence"], 7);
    assert_eq!(picture.body[4 + length..][..2], [0xff, 0xd8], "a JPEG");
    let metrics = ask(server.address(), "GET /metrics", "");
    assert!(metrics.text().contains("hydroline_frames_received_total 0"));
}

#[test]
fn stop_takes_the_key_of_the_session_and_nothing_less() {
    let (server, feed, stops) = started(None);
    let address = server.address();
    let key = key(&ask(address, "GET /", "").text());
    let with = |headers: &str| ask(address, "POST /stop", headers).status;
    let own = format!("X-Hydroline-Session: {key}\r\n");
    assert_eq!(with(""), 403);
    assert_eq!(
        with("X-Hydroline-Session: 00000000000000000000000000000000\r\n"),
        403
    );
    assert_eq!(with(&format!("{own}{own}")), 403);
    assert_eq!(with(&format!("{own}Origin: http://evil.example\r\n")), 403);
    assert_eq!(with(&format!("{own}Sec-Fetch-Site: cross-site\r\n")), 403);
    assert_eq!(with(&format!("{own}Content-Length: 5\r\n\r\nhello")), 413);
    assert_eq!(
        with(&format!("{own}Transfer-Encoding: chunked\r\n\r\n0\r\n")),
        413
    );
    assert_eq!(ask(address, "GET /stop", &own).status, 405);
    assert_eq!(stops.load(Ordering::SeqCst), 0);
    assert!(!feed.pressed());
    assert_eq!(
        with(&format!(
            "{own}Origin: http://{address}\r\nContent-Length: 0\r\n"
        )),
        200
    );
    assert_eq!((stops.load(Ordering::SeqCst), feed.pressed()), (1, true));
}

#[test]
fn with_a_token_nothing_is_sent_to_who_has_none() {
    let (server, _feed, stops) = started(Some(TOKEN));
    let address = server.address();
    for line in [
        "GET /",
        "GET /state",
        "GET /picture",
        "GET /metrics",
        "POST /stop",
        "GET /x",
        "PUT /",
    ] {
        for headers in [
            "",
            "Authorization: Bearer a-token-for-tests-0124\r\n",
            "Cookie: token=a-token-for-tests-0123\r\n",
        ] {
            let answer = ask(address, line, headers);
            assert_eq!(answer.status, 401, "{line} {headers}");
            assert!(!answer.text().contains("secret-rig") && !answer.text().contains("session"));
        }
    }
    assert_eq!(
        ask(address, &format!("GET /?token={TOKEN}"), "").status,
        200
    );
    let bearer = format!("Authorization: Bearer {TOKEN}\r\n");
    assert!(
        ask(address, "GET /state", &bearer)
            .text()
            .contains("secret-rig")
    );
    assert_eq!(stops.load(Ordering::SeqCst), 0);
    assert!(server.url().ends_with(TOKEN));
}

#[test]
fn a_name_that_is_pointed_at_us_is_refused() {
    let (server, _feed, _) = started(None);
    let request = b"GET /state HTTP/1.1\r\nHost: evil.example\r\n\r\n";
    assert_eq!(exchange(server.address(), request).unwrap().status, 421);
    let request = b"GET /state HTTP/1.0\r\n\r\n";
    assert_eq!(exchange(server.address(), request).unwrap().status, 421);
}

#[test]
fn an_open_address_without_a_token_is_not_served() {
    let feed = Arc::new(Feed::new(true));
    let error = Server::start("0.0.0.0:0".parse().unwrap(), None, feed).unwrap_err();
    assert!(matches!(error, LiveError::Open { .. }));
}

#[test]
fn garbage_costs_only_its_own_connection() {
    let (server, _feed, stops) = started(None);
    let address = server.address();
    let mut state = 1u64;
    let mut byte = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as u8
    };
    let heads: [&[u8]; 6] = [
        b"",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n",
        b"POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Hydroline-Session: ",
        b"GET /state?after=",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        b"POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 99999999999999999999\r\n\r\n",
    ];
    for round in 0..120 {
        let mut request = heads[round % heads.len()].to_vec();
        request.extend((0..1 + round * 5).map(|_| byte()));
        request.extend(b"\r\n\r\n");
        // Refused with a status, or closed.
        if let Some(answer) = exchange(address, &request) {
            assert!(
                answer.status >= 400 || request.starts_with(b"GET /"),
                "{}",
                answer.status
            );
        }
    }
    let mut long = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ".to_vec();
    long.resize(1 << 20, b'a');
    assert!(exchange(address, &long).is_none_or(|a| a.status == 431));
    assert_eq!(stops.load(Ordering::SeqCst), 0);
    assert_eq!(ask(address, "GET /state", "").status, 200);
}

#[test]
fn idle_connections_are_given_back() {
    let (server, _feed, _) = started(None);
    let address = server.address();
    let idle: Vec<TcpStream> = (0..WAITING_MAX + 8).map(|_| connect(address)).collect();
    // The oldest give way to the newest, the others end when no head has come.
    let began = Instant::now();
    let mut ended = 0;
    for mut stream in idle {
        ended += usize::from(matches!(stream.read(&mut [0; 256]), Ok(_) | Err(_)));
    }
    assert_eq!(ended, WAITING_MAX + 8);
    assert!(began.elapsed() < HEAD_WITHIN * 3);
    assert_eq!(ask(address, "GET /state", "").status, 200);
}

/// One of a crowd: it sends nothing, half a head, garbage, or asks without ever reading.
fn one_of_a_crowd(address: SocketAddr, k: usize) -> TcpStream {
    let mut stream = connect(address);
    let asks = format!("GET /state HTTP/1.1\r\nHost: {address}\r\n\r\n");
    let sent: &[u8] = match k % 4 {
        0 => b"",
        1 => b"POST /stop HTTP/1.1\r\nHo",
        2 => b"\x16\x03\x01\x02\0\x01\0\r\n\r\n",
        _ => asks.as_bytes(),
    };
    // It may have been closed by then.
    let _ = stream.write_all(sent);
    stream
}

#[test]
fn a_crowd_that_takes_every_place_does_not_keep_stop_out() {
    for token in [None, Some(TOKEN)] {
        let (server, _feed, stops) = started(token);
        let address = server.address();
        let opens = format!("Authorization: Bearer {TOKEN}\r\n");
        let key = key(&ask(address, "GET /", &opens).text());
        // A page that is open: its connection stays, whoever comes.
        let mut page = connect(address);
        let state = format!("GET /state HTTP/1.1\r\nHost: {address}\r\n{opens}\r\n").into_bytes();
        page.write_all(&state).unwrap();
        assert!(page.read(&mut [0; 4096]).unwrap() > 0);
        let mut crowd: Vec<TcpStream> = (0..250).map(|k| one_of_a_crowd(address, k)).collect();
        for pressed in 1..=20 {
            crowd.extend((0..5).map(|k| one_of_a_crowd(address, k)));
            let headers = format!("{opens}X-Hydroline-Session: {key}\r\n");
            let answer = ask(address, "POST /stop", &headers);
            assert_eq!(answer.status, 200, "press {pressed}");
            assert_eq!(stops.load(Ordering::SeqCst), pressed);
        }
        page.write_all(&state).unwrap();
        assert!(page.read(&mut [0; 4096]).unwrap() > 0, "it was put out");
        drop(crowd);
    }
}

#[test]
fn a_target_that_names_another_computer_is_held_against_the_rule_of_hosts() {
    let (server, _feed, stops) = started(None);
    let address = server.address();
    let own = format!(
        "X-Hydroline-Session: {}\r\n",
        key(&ask(address, "GET /", "").text())
    );
    for host in [
        "evil.example",
        "127.0.0.1@evil.example",
        "localhost.evil.example:80",
    ] {
        let status = |line: String| ask(address, &line, &own).status;
        assert_eq!(status(format!("GET http://{host}/state")), 421, "{host}");
        assert_eq!(status(format!("POST http://{host}/stop")), 421, "{host}");
    }
    assert_eq!(stops.load(Ordering::SeqCst), 0);
    let line = format!("GET http://{address}/state");
    assert_eq!(ask(address, &line, "").status, 200);
}

#[test]
fn guesses_of_the_token_are_limited_and_stop_is_not() {
    let (server, _feed, stops) = started(Some(TOKEN));
    let address = server.address();
    let opens = format!("Authorization: Bearer {TOKEN}\r\n");
    let own = format!(
        "{opens}X-Hydroline-Session: {}\r\n",
        key(&ask(address, "GET /", &opens).text())
    );
    let mut page = connect(address);
    let state = format!("GET /state HTTP/1.1\r\nHost: {address}\r\n{opens}\r\n");
    page.write_all(state.as_bytes()).unwrap();
    assert!(page.read(&mut [0; 4096]).unwrap() > 0);
    let guess = |k: usize| {
        ask(
            address,
            &format!("GET /?token=a-token-for-tests-{k:04}"),
            "",
        )
    };
    let refused: Vec<u16> = (1000..1100).map(|k| guess(k).status).collect();
    assert_eq!(refused.iter().filter(|s| **s == 401).count(), 10);
    assert_eq!(refused.iter().filter(|s| **s == 429).count(), 90);
    let answer = guess(2000);
    assert!(answer.head.contains("retry-after: "), "{}", answer.head);
    // Nor is the right one distinguished now.
    assert_eq!(ask(address, "GET /state", &opens).status, 429);
    // Who has no token at all guesses nothing; a page that is open goes on, and its STOP does.
    assert_eq!(ask(address, "GET /state", "").status, 401);
    page.write_all(state.as_bytes()).unwrap();
    let mut head = [0; 4096];
    let n = page.read(&mut head).unwrap();
    assert!(head[..n].starts_with(b"HTTP/1.1 200"));
    // On a connection of its own too, as its requests have the session's key.
    assert_eq!(ask(address, "GET /state", &own).status, 200);
    assert_eq!(ask(address, "POST /stop", &own).status, 200);
    assert_eq!(stops.load(Ordering::SeqCst), 1);
}

#[test]
fn a_viewer_that_stops_reading_delays_nobody() {
    let (server, feed, _) = started(None);
    let address = server.address();
    let mut deaf = connect(address);
    let one = format!("GET / HTTP/1.1\r\nHost: {address}\r\n\r\n");
    // More answers than a socket buffers, none of them read.
    let _ = deaf.write_all(one.repeat(400).as_bytes());
    let mut last = 0;
    for k in 0..30 {
        feed.publish(State {
            phase: format!("round {k}"),
            ..State::default()
        });
        let answer = ask(address, &format!("GET /state?after={last}"), "");
        let json: serde_json::Value = serde_json::from_slice(&answer.body).unwrap();
        assert_eq!(json["state"]["phase"], format!("round {k}"));
        last = json["number"].as_u64().unwrap();
    }
    drop(deaf);
}

#[test]
fn the_end_of_the_server_is_no_wait() {
    let (server, feed, _) = started(None);
    let address = server.address();
    let number = feed.states().borrow().number;
    let waiting =
        std::thread::spawn(move || ask(address, &format!("GET /state?after={number}"), "").status);
    std::thread::sleep(Duration::from_millis(50));
    feed.publish(State {
        ended: true,
        ..State::default()
    });
    drop(server);
    assert_eq!(waiting.join().unwrap(), 200, "the last state arrives");
    assert!(TcpStream::connect(address).is_err());
}

/// A page that only shows, some of its answers slow or broken.
struct Slow;

impl Site for Slow {
    fn page(&self, guard: &Guard) -> std::io::Result<crate::page::Page> {
        crate::page::another(guard, "shown", "<p>shown</p>", "", "")
    }

    fn answer(&self, path: &str, query: &str) -> Option<crate::Reply> {
        match path {
            "/slow" => std::thread::sleep(Duration::from_millis(800)),
            "/broken" => panic!("a bug in a page's answer"),
            "/saved" => {
                let mut reply = crate::Reply::of("text/csv", query.as_bytes().to_vec());
                reply.download = Some("run \"7\"\r\nX: y.csv".to_owned());
                return Some(reply);
            }
            _ => return None,
        }
        Some(crate::Reply::words(404, "nothing there"))
    }
}

#[test]
fn a_page_that_only_shows_is_guarded_and_no_answer_waits_for_another() {
    let here = "127.0.0.1:0".parse().unwrap();
    let server = Server::showing(here, None, Arc::new(Slow)).unwrap();
    let address = server.address();
    let page = ask(address, "GET /", "");
    assert!(page.status == 200 && page.text().contains("<body>\n<p>shown</p><script nonce="));
    assert!(
        page.head
            .contains("content-security-policy: default-src 'none'; script-src 'nonce-")
    );
    let slow = std::thread::spawn(move || ask(address, "GET /slow", "").status);
    let began = Instant::now();
    let saved = ask(address, "GET /saved?a=1", "");
    assert!(began.elapsed() < Duration::from_millis(500), "it waited");
    assert_eq!((saved.status, saved.text().as_str()), (200, "a=1"));
    // A name ends no header.
    assert!(
        saved.head.contains("filename=\"run__7___x__y.csv\""),
        "{}",
        saved.head
    );
    assert!(
        saved
            .head
            .contains("content-security-policy: default-src 'none'")
    );
    assert_eq!(slow.join().unwrap(), 404);
    assert_eq!(ask(address, "GET /broken", "").status, 500);
    assert_eq!(ask(address, "GET /nothing", "").status, 404);
    assert_eq!(ask(address, "POST /saved", "").status, 405);
    assert_eq!(
        ask(address, "GET /saved", "Origin: http://evil.example\r\n").status,
        403
    );
    let request = b"GET /saved HTTP/1.1\r\nHost: evil.example\r\n\r\n";
    assert_eq!(exchange(address, request).unwrap().status, 421);
    let open = "0.0.0.0:0".parse().unwrap();
    let error = Server::showing(open, None, Arc::new(Slow)).unwrap_err();
    assert!(
        error.to_string().starts_with("--listen 0.0.0.0:0: "),
        "{error}"
    );
}

mod foxglove {
    use super::*;
    use tokio_tungstenite::tungstenite::client::IntoClientRequest;
    use tokio_tungstenite::tungstenite::{Message, WebSocket, client};

    type Socket = WebSocket<TcpStream>;

    fn open(address: SocketAddr, origin: Option<&str>) -> Result<Socket, String> {
        let mut request = format!("ws://{address}/foxglove")
            .into_client_request()
            .unwrap();
        let headers = request.headers_mut();
        let protocols = "foxglove.sdk.v1.1, foxglove.sdk.v1";
        headers.insert("sec-websocket-protocol", protocols.parse().unwrap());
        if let Some(origin) = origin {
            headers.insert("origin", origin.parse().unwrap());
        }
        let opened = client(request, connect(address)).map_err(|e| e.to_string())?;
        assert_eq!(
            opened.1.headers()["sec-websocket-protocol"],
            "foxglove.sdk.v1"
        );
        Ok(opened.0)
    }

    fn json(socket: &mut Socket) -> serde_json::Value {
        serde_json::from_str(socket.read().unwrap().to_text().unwrap()).unwrap()
    }

    fn subscribe(socket: &mut Socket, channels: &[u64]) {
        let wanted: Vec<_> = channels
            .iter()
            .map(|c| serde_json::json!({"id": c + 10, "channelId": c}))
            .collect();
        let text = serde_json::json!({"op": "subscribe", "subscriptions": wanted});
        socket.send(Message::text(text.to_string())).unwrap();
    }

    #[test]
    fn a_viewer_sees_state_and_picture_and_the_end() {
        let (server, feed, stops) = started(None);
        let mut socket = open(server.address(), None).unwrap();
        assert_eq!(json(&mut socket)["name"], "secret-rig");
        let advertised = json(&mut socket);
        let number = |topic: &str| {
            let channels = advertised["channels"].as_array().unwrap();
            let of = channels.iter().find(|c| c["topic"] == topic).unwrap();
            of["id"].as_u64().unwrap()
        };
        let (image, state) = (number("/camera/image"), number("/live/state"));
        subscribe(&mut socket, &[image, state]);
        let (mut images, mut titles) = (0, Vec::new());
        feed.publish(State {
            title: "newer".to_owned(),
            ..State::default()
        });
        while images == 0 || titles.last().is_none_or(|t| t != "newer") {
            let message = socket.read().unwrap().into_data();
            assert_eq!(message[0], 1);
            let id = u64::from(u32::from_le_bytes(message[1..5].try_into().unwrap()));
            if id == image + 10 {
                // SOI of the JPEG is somewhere in the message.
                assert!(message.windows(2).any(|w| w == [0xff, 0xd8]));
                images += 1;
            } else {
                assert_eq!(id, state + 10);
                let sent: serde_json::Value = serde_json::from_slice(&message[13..]).unwrap();
                titles.push(sent["title"].as_str().unwrap().to_owned());
            }
        }
        assert!(feed.is_watched());
        // Nothing that it says stops anything.
        socket.send(Message::text(r#"{"op":"stop"}"#)).unwrap();
        socket.send(Message::binary(vec![1, 2, 3])).unwrap();
        drop(server);
        let closed = std::iter::from_fn(|| Some(socket.read()))
            .find(|m| m.as_ref().map_or(true, Message::is_close));
        assert!(closed.is_some());
        assert_eq!(stops.load(Ordering::SeqCst), 0);
    }

    #[test]
    fn another_site_is_no_viewer() {
        let (server, _feed, _) = started(None);
        assert!(open(server.address(), Some("https://evil.example")).is_err());
        assert!(open(server.address(), Some("file://")).is_err());
        assert!(open(server.address(), Some("https://app.foxglove.dev")).is_ok());
        let (closed, _feed, _) = started(Some(TOKEN));
        assert!(open(closed.address(), None).is_err());
        let plain = ask(server.address(), "GET /foxglove", "");
        assert_eq!(plain.status, 426);
        assert!(plain.text().contains("ws://"));
    }

    #[test]
    fn viewers_have_places_like_everyone_until_they_go() {
        let (server, _feed, _) = started(None);
        let open_all = || -> Vec<Socket> {
            let opened = (0..KEPT_PER_PEER).map(|_| open(server.address(), None));
            opened.map(Result::unwrap).collect()
        };
        let sockets = open_all();
        assert!(
            open(server.address(), None).is_err(),
            "all places are taken"
        );
        drop(sockets);
        let end = Instant::now() + Duration::from_secs(10);
        while open(server.address(), None).is_err() {
            assert!(Instant::now() < end, "their places are free again");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    #[test]
    fn the_layout_is_there_to_be_imported() {
        let (server, _feed, _) = started(None);
        let layout = ask(server.address(), "GET /foxglove-layout.json", "");
        let layout: serde_json::Value = serde_json::from_slice(&layout.body).unwrap();
        assert!(layout["configById"]["Image!camera"].is_object());
    }
}
