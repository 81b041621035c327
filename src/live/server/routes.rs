//! The axum adapter: a request's head to the guard, its answer to the wire.

use super::super::feed::{Feed, Numbered};
use super::super::foxglove::layout;
use super::super::guard::{Asked, Guard, Header, Refusal, Route, SESSION_HEADER};
use super::super::guesses::{GUESS_EVERY, Guesses};
use super::super::{metrics, page};
use super::encoder::Encoder;
use super::foxglove;
use super::open::{Connection, Open};
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Router};
use bytes::Bytes;
use hydroline_core::lock::Lock;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Longest wait for something newer; then the viewer asks again.
const NEWER_WITHIN: Duration = Duration::from_secs(1);

pub(super) struct Shared {
    pub(super) feed: Arc<Feed>,
    guard: Guard,
    open: Open,
    guesses: Mutex<Guesses>,
    pub(super) encoder: Encoder,
    /// The newest state as JSON, written once for all viewers.
    json: Mutex<Option<(u64, Bytes)>>,
}

/// The routes; every request passes the guard first.
pub(super) fn router(feed: Arc<Feed>, guard: Guard, open: Open) -> Router {
    let shared = Arc::new(Shared {
        feed,
        guard,
        open,
        guesses: Mutex::default(),
        encoder: Encoder::default(),
        json: Mutex::new(None),
    });
    Router::new().fallback(answer).with_state(shared)
}

async fn answer(
    State(shared): State<Arc<Shared>>,
    Extension(connection): Extension<Connection>,
    request: Request,
) -> Response {
    let checked = shared.check(&connection, &asked(&request));
    // Where no place is left it is answered all the same, STOP before all, and then goes.
    let kept = checked.is_ok() && connection.keep();
    // Nothing below reads a body.
    let mut response = match checked {
        Ok(Route::Foxglove) if !kept => full(),
        Ok(Route::Foxglove) => foxglove::answer(&shared, connection, request),
        Ok(Route::Page) => shared.page(),
        Ok(Route::State { after }) => shared.state(after).await,
        Ok(Route::Picture { after }) => shared.picture(after).await,
        Ok(Route::Metrics) => shared.metrics(),
        Ok(Route::FoxgloveLayout) => shared.layout(),
        Ok(Route::Stop) => shared.stop(),
        Err(refusal) => refuse(refusal),
    };
    if !kept {
        // Whatever else was sent behind it is not looked at.
        let close = HeaderValue::from_static("close");
        response.headers_mut().insert(header::CONNECTION, close);
    }
    protect(response.headers_mut());
    response
}

/// The head, as the guard reads it.
fn asked(request: &Request) -> Asked<'_> {
    let headers = request.headers();
    let one = |name: &str| once(headers, name);
    let length = one("content-length");
    Asked {
        method: request.method().as_str(),
        path: request.uri().path(),
        query: request.uri().query().unwrap_or_default(),
        authority: request.uri().authority().map(|a| a.as_str()),
        host: one("host"),
        origin: one("origin"),
        fetch_site: one("sec-fetch-site"),
        fetch_mode: one("sec-fetch-mode"),
        authorization: one("authorization"),
        session: one(SESSION_HEADER),
        has_body: !matches!(length, Header::Absent | Header::Once("0"))
            || headers.contains_key(header::TRANSFER_ENCODING),
    }
}

fn once<'a>(headers: &'a HeaderMap, name: &str) -> Header<'a> {
    let mut values = headers.get_all(name).iter();
    match (values.next(), values.next()) {
        (None, _) => Header::Absent,
        (Some(value), None) => value.to_str().map_or(Header::Unclear, Header::Once),
        (Some(_), Some(_)) => Header::Unclear,
    }
}

/// Headers that every answer carries: it is not kept, not guessed at, not framed, not read by other sites.
fn protect(headers: &mut HeaderMap) {
    for (name, value) in [
        ("cache-control", "no-store"),
        ("x-content-type-options", "nosniff"),
        ("x-frame-options", "DENY"),
        ("referrer-policy", "no-referrer"),
        ("cross-origin-resource-policy", "same-origin"),
        ("cross-origin-opener-policy", "same-origin"),
    ] {
        headers.insert(
            HeaderName::from_static(name),
            HeaderValue::from_static(value),
        );
    }
    let policy = HeaderValue::from_static("default-src 'none'; frame-ancestors 'none'");
    headers
        .entry(header::CONTENT_SECURITY_POLICY)
        .or_insert(policy);
}

fn refuse(refusal: Refusal) -> Response {
    let status = StatusCode::from_u16(refusal.status()).unwrap_or(StatusCode::FORBIDDEN);
    let mut response = (status, format!("{refusal}\n")).into_response();
    let headers = response.headers_mut();
    match refusal {
        Refusal::Method => {
            headers.insert(header::ALLOW, HeaderValue::from_static("GET, POST"));
        }
        Refusal::Guesses => {
            let wait = HeaderValue::from(GUESS_EVERY.as_secs());
            headers.insert(header::RETRY_AFTER, wait);
        }
        _ => {}
    }
    response
}

fn full() -> Response {
    let words = "as many viewers look as there are places for: close one of them\n";
    (StatusCode::SERVICE_UNAVAILABLE, words).into_response()
}

fn typed(kind: &'static str, body: impl Into<Body>) -> Response {
    ([(header::CONTENT_TYPE, kind)], body.into()).into_response()
}

/// The newest value once it is newer than `after`; `None` when none came in time.
async fn newer<T>(from: &mut watch::Receiver<Numbered<T>>, after: u64) -> Option<Numbered<T>> {
    let newest = from.wait_for(|n| n.value.is_some() && n.number > after);
    let newest = tokio::time::timeout(NEWER_WITHIN, newest).await;
    newest.ok()?.ok().map(|n| n.clone())
}

impl Shared {
    /// The guard's answer; a computer that guesses tokens does not learn whether its next one is right.
    fn check(&self, connection: &Connection, asked: &Asked<'_>) -> Result<Route, Refusal> {
        let guessing = !connection.is_kept() && !self.guard.has_key(asked);
        let offered = self.guard.offered(asked).filter(|_| guessing);
        let Some(offered) = offered else {
            return self.guard.check(asked);
        };
        let (peer, now) = (connection.peer(), Instant::now());
        self.guesses.held().admit(peer, offered, now)?;
        let checked = self.guard.check(asked);
        if checked == Err(Refusal::Token) {
            self.guesses.held().wrong(peer, offered, now);
        }
        checked
    }

    fn page(&self) -> Response {
        let Ok(page) = page::page(&self.guard) else {
            return StatusCode::INTERNAL_SERVER_ERROR.into_response();
        };
        let mut response = typed("text/html; charset=utf-8", page.html);
        if let Ok(policy) = HeaderValue::from_str(&page.policy) {
            response
                .headers_mut()
                .insert(header::CONTENT_SECURITY_POLICY, policy);
        }
        response
    }

    async fn state(&self, after: u64) -> Response {
        let Some(Numbered {
            number,
            value: Some(state),
        }) = newer(&mut self.feed.states(), after).await
        else {
            return StatusCode::NO_CONTENT.into_response();
        };
        let mut json = self.json.held();
        let bytes = match &*json {
            Some((of, bytes)) if *of == number => bytes.clone(),
            _ => {
                let text = serde_json::json!({ "number": number, "state": *state });
                let bytes = Bytes::from(text.to_string());
                *json = Some((number, bytes.clone()));
                bytes
            }
        };
        drop(json);
        typed("application/json", bytes)
    }

    async fn picture(&self, after: u64) -> Response {
        let mut pictures = self.feed.pictures();
        if newer(&mut pictures, after).await.is_none() {
            return StatusCode::NO_CONTENT.into_response();
        }
        let Some(encoded) = self.encoder.newest(&pictures).await else {
            return StatusCode::NO_CONTENT.into_response();
        };
        let mut response = typed("application/octet-stream", encoded.bytes);
        let number = HeaderValue::from(encoded.number);
        response.headers_mut().insert("x-number", number);
        response
    }

    fn metrics(&self) -> Response {
        let newest = self.feed.states().borrow().value.clone();
        let text = metrics::text(&newest.unwrap_or_default(), self.open.count());
        typed(metrics::CONTENT_TYPE, text)
    }

    fn layout(&self) -> Response {
        let newest = self.feed.states().borrow().value.clone();
        let newest = newest.unwrap_or_default();
        let names: Vec<&str> = newest.thrusters.iter().map(|t| t.name.as_str()).collect();
        typed("application/json", layout(&names))
    }

    fn stop(&self) -> Response {
        if self.feed.press() {
            typed("application/json", r#"{"stopped":true}"#)
        } else {
            let words = "there are no thrusters to stop in this run\n";
            (StatusCode::CONFLICT, words).into_response()
        }
    }
}
