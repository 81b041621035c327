//! A page that only shows ([`Site`]), behind the same guard: a request's head to the guard, its path to the site.

use super::super::guard::{Guard, Refusal};
use super::super::site::{Reply, Site};
use super::gate::Gate;
use super::open::Connection;
use super::routes::{asked, close_unless, protect, refuse, sent, typed};
use axum::extract::{Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Router};
use std::sync::Arc;

struct Shared {
    gate: Gate,
    site: Arc<dyn Site>,
}

/// The routes; every request passes the guard first.
pub(super) fn router(site: Arc<dyn Site>, guard: Guard) -> Router {
    let gate = Gate::new(guard);
    Router::new()
        .fallback(answer)
        .with_state(Arc::new(Shared { gate, site }))
}

async fn answer(
    State(shared): State<Arc<Shared>>,
    Extension(connection): Extension<Connection>,
    request: Request,
) -> Response {
    let checked = (shared.gate).check(&connection, &asked(&request), Guard::look);
    let kept = checked.is_ok() && connection.keep();
    let mut response = match checked {
        Ok(()) if request.uri().path() == "/" => sent(shared.site.page(shared.gate.guard())),
        Ok(()) => {
            let uri = request.uri();
            let path = uri.path().to_owned();
            let query = uri.query().unwrap_or_default().to_owned();
            shared.below(path, query).await
        }
        Err(refusal) => refuse(refusal),
    };
    close_unless(kept, &mut response);
    protect(response.headers_mut());
    response
}

impl Shared {
    async fn below(&self, path: String, query: String) -> Response {
        let site = self.site.clone();
        // It reads files: other requests do not wait for it.
        let work = tokio::task::spawn_blocking(move || site.answer(&path, &query));
        match work.await {
            Ok(Some(reply)) => written(reply),
            Ok(None) => refuse(Refusal::Nothing),
            Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
        }
    }
}

fn written(reply: Reply) -> Response {
    let mut response = typed(reply.kind, reply.body);
    *response.status_mut() =
        StatusCode::from_u16(reply.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    if let Some(name) = reply.download {
        // Letters that stand in a quoted name without an escape.
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        let name: String = name
            .chars()
            .map(|c| if plain(c) { c } else { '_' })
            .collect();
        let words = format!("attachment; filename=\"{name}\"");
        if let Ok(value) = HeaderValue::from_str(&words) {
            let headers = response.headers_mut();
            headers.insert(header::CONTENT_DISPOSITION, value);
        }
    }
    response
}
