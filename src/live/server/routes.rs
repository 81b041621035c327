//! The axum adapter: a request's head to the guard, its answer to the wire.

use super::super::feed::{Feed, Numbered};
use super::super::foxglove::layout;
use super::super::guard::{Asked, Guard, Header, Refusal, Route, SESSION_HEADER};
use super::super::guesses::GUESS_EVERY;
use super::super::{metrics, page};
use super::encoder::Encoder;
use super::foxglove;
use super::gate::Gate;
use super::open::{Connection, Open};
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Router};
use bytes::Bytes;
use hydroline_core::lock::Lock;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::watch;

/// Longest wait for something newer; then the viewer asks again.
const NEWER_WITHIN: Duration = Duration::from_secs(1);

pub(super) struct Shared {
    pub(super) feed: Arc<Feed>,
    gate: Gate,
    open: Open,
    pub(super) encoder: Encoder,
    /// The newest state as JSON, written once for all viewers.
    json: Mutex<Option<(u64, Bytes)>>,
}

/// The routes; every request passes the guard first.
pub(super) fn router(feed: Arc<Feed>, guard: Guard, open: Open) -> Router {
    let shared = Arc::new(Shared {
        feed,
        gate: Gate::new(guard),
        open,
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
    let checked = (shared.gate).check(&connection, &asked(&request), Guard::check);
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
    close_unless(kept, &mut response);
    protect(response.headers_mut());
    response
}

/// Closes the connection behind an answer unless its place is kept.
pub(super) fn close_unless(kept: bool, response: &mut Response) {
    if !kept {
        // Whatever else was sent behind it is not looked at.
        let close = HeaderValue::from_static("close");
        response.headers_mut().insert(header::CONNECTION, close);
    }
}

/// The head, as the guard reads it.
pub(super) fn asked(request: &Request) -> Asked<'_> {
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
pub(super) fn protect(headers: &mut HeaderMap) {
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

pub(super) fn refuse(refusal: Refusal) -> Response {
    let status = StatusCode::from_u16(refusal.status()).unwrap_or(StatusCode::FORBIDDEN);
    let mut response = (status, format!("{refusal}\n")).into_response();
    let headers = response.headers_mut();
    match refusal {
        Refusal::Method => {
            headers.insert(header::ALLOW, HeaderValue::from_static("GET, POST"));
        }
        Refusal::OnlyGet => {
            headers.insert(header::ALLOW, HeaderValue::from_static("GET"));
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

pub(super) fn typed(kind: &'static str, body: impl Into<Body>) -> Response {
    ([(header::CONTENT_TYPE, kind)], body.into()).into_response()
}

/// A page with its policy.
pub(super) fn sent(page: std::io::Result<page::Page>) -> Response {
    let Ok(page) = page else {
        return StatusCode::INTERNAL_SERVER_ERROR.into_response();
    };
    let mut response = typed("text/html; charset=utf-8", page.html);
    if let Ok(policy) = HeaderValue::from_str(&page.policy) {
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_SECURITY_POLICY, policy);
    }
    response
}

/// The newest value once it is newer than `after`; `None` when none came in time.
async fn newer<T>(from: &mut watch::Receiver<Numbered<T>>, after: u64) -> Option<Numbered<T>> {
    let newest = from.wait_for(|n| n.value.is_some() && n.number > after);
    let newest = tokio::time::timeout(NEWER_WITHIN, newest).await;
    newest.ok()?.ok().map(|n| n.clone())
}

impl Shared {
    fn page(&self) -> Response {
        sent(page::page(self.gate.guard()))
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
