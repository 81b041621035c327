//! The Foxglove viewer's connection: an upgrade of a request that has passed the guard, then one task per viewer.
//!
//! As on the page the newest wins: a viewer that is slow is sent less, and one that takes nothing is cut off.

use super::super::foxglove::{Channel, Sent, Viewer, greeting, of_picture, protocol};
use super::ended;
use super::open::Connection;
use super::routes::Shared;
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use hyper::upgrade::Upgraded;
use hyper_util::rt::TokioIo;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::handshake::derive_accept_key;
use tokio_tungstenite::tungstenite::protocol::{Role, WebSocketConfig};
use tokio_tungstenite::tungstenite::{Error, Message};

/// Longest message of a viewer: subscriptions of some words each.
const HEARD_MAX: usize = 64 << 10;
/// Bytes that wait for a viewer before a write waits itself: one picture.
const WAITS_MAX: usize = 2 << 20;

/// Agrees on the protocol and lets the connection go on in it.
pub(super) fn answer(
    shared: &Arc<Shared>,
    connection: Connection,
    mut request: Request,
) -> Response {
    let headers = request.headers();
    let text = |name: header::HeaderName| headers.get(name).and_then(|v| v.to_str().ok());
    let offered = joined(headers, &header::SEC_WEBSOCKET_PROTOCOL);
    let is_upgrade = text(header::UPGRADE).is_some_and(|v| v.eq_ignore_ascii_case("websocket"))
        && text(header::SEC_WEBSOCKET_VERSION) == Some("13");
    let (true, Some(key), Some(protocol)) = (
        is_upgrade,
        headers.get(header::SEC_WEBSOCKET_KEY),
        protocol(&offered),
    ) else {
        let words = "this is for Foxglove: open a connection, Foxglove WebSocket, to this address with ws:// in front\n";
        return (StatusCode::UPGRADE_REQUIRED, words).into_response();
    };
    let accept = derive_accept_key(key.as_bytes());
    let Ok(accept) = HeaderValue::from_str(&accept) else {
        return StatusCode::BAD_REQUEST.into_response();
    };
    let upgrade = hyper::upgrade::on(&mut request);
    let shared = shared.clone();
    tokio::spawn(async move {
        let Ok(upgraded) = upgrade.await else { return };
        let config = WebSocketConfig::default()
            .max_message_size(Some(HEARD_MAX))
            .max_frame_size(Some(HEARD_MAX))
            .max_write_buffer_size(WAITS_MAX);
        let io = TokioIo::new(upgraded);
        let socket = WebSocketStream::from_raw_socket(io, Role::Server, Some(config)).await;
        if let Err(error) = serve(&shared, socket, connection).await {
            tracing::debug!("Foxglove viewer: {error}");
        }
    });
    let mut response = StatusCode::SWITCHING_PROTOCOLS.into_response();
    for (name, value) in [
        (header::UPGRADE, HeaderValue::from_static("websocket")),
        (header::CONNECTION, HeaderValue::from_static("upgrade")),
        (header::SEC_WEBSOCKET_ACCEPT, accept),
        (
            header::SEC_WEBSOCKET_PROTOCOL,
            HeaderValue::from_static(protocol),
        ),
    ] {
        response.headers_mut().insert(name, value);
    }
    response
}

/// All values of a header that may stand there several times.
fn joined(headers: &HeaderMap, name: &header::HeaderName) -> String {
    let values = headers.get_all(name).iter();
    let values: Vec<&str> = values.filter_map(|v| v.to_str().ok()).collect();
    values.join(",")
}

fn now_ns() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    now.map_or(0, |d| d.as_nanos() as u64)
}

type Socket = WebSocketStream<TokioIo<Upgraded>>;

/// One viewer until it or the run ends.
async fn serve(
    shared: &Shared,
    mut socket: Socket,
    mut connection: Connection,
) -> Result<(), Error> {
    let mut states = shared.feed.states();
    let (title, session) = {
        let newest = states.borrow();
        let title = newest.value.as_ref().map(|s| s.title.clone());
        (title.unwrap_or_default(), newest.number.to_string())
    };
    for text in greeting(&title, &session) {
        socket.send(Message::text(text)).await?;
    }
    let (mut viewer, mut sent) = (Viewer::default(), Sent::default());
    let mut pictures = shared.feed.pictures();
    loop {
        let looks = viewer.wants(Channel::is_picture);
        // Before the first subscription nothing is sent, so that events are not sent to nobody.
        let listens = viewer.wants(|_| true);
        tokio::select! {
            () = ended(&mut connection.ending) => {
                return socket.close(None).await;
            }
            heard = socket.next() => match heard {
                None | Some(Ok(Message::Close(_))) => return Ok(()),
                Some(Ok(Message::Text(text))) => {
                    if let Some(answer) = viewer.hear(&text) {
                        socket.send(Message::text(answer)).await?;
                    }
                    // A viewer that has just come is sent what there is already.
                    states.mark_changed();
                    pictures.mark_changed();
                }
                // A ping is answered by the library; binary messages would publish or set something.
                Some(Ok(_)) => {}
                Some(Err(error)) => return Err(error),
            },
            changed = states.changed(), if listens => {
                if changed.is_err() {
                    return socket.close(None).await;
                }
                let newest = states.borrow_and_update().value.clone();
                if let Some(state) = newest {
                    send(&mut socket, sent.of_state(&viewer, &state, now_ns())).await?;
                }
                if looks {
                    // Says once more that somebody looks.
                    let _ = shared.feed.pictures();
                }
            }
            changed = pictures.changed(), if looks => {
                if changed.is_err() {
                    return socket.close(None).await;
                }
                pictures.mark_unchanged();
                if let Some(encoded) = shared.encoder.newest(&pictures).await {
                    let frames = of_picture(&viewer, &encoded.picture, encoded.jpeg(), encoded.scale, now_ns());
                    send(&mut socket, frames).await?;
                }
            }
        }
    }
}

async fn send(socket: &mut Socket, frames: Vec<Bytes>) -> Result<(), Error> {
    for frame in frames {
        socket.feed(Message::Binary(frame)).await?;
    }
    socket.flush().await
}
