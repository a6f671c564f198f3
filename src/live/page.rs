//! The page and its assets, compiled in. Nothing is fetched from other servers.

use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{Html, IntoResponse};

const PAGE: &str = include_str!("../../assets/live/page.html");
/// Style sheet of the report, with the additions of the live page.
const STYLE: &str = concat!(include_str!("../../assets/report/style.css"), include_str!("../../assets/live/style.css"));
/// Charts and 3D view are those of the report.
const SCRIPT: &str = concat!(
    "'use strict';\n",
    include_str!("../../assets/report/text.js"),
    include_str!("../../assets/report/charts.js"),
    include_str!("../../assets/report/shapes.js"),
    include_str!("../../assets/report/view.js"),
    include_str!("../../assets/live/cut.js"),
    include_str!("../../assets/live/sample.js"),
    include_str!("../../assets/live/curves.js"),
    include_str!("../../assets/live/main.js"),
);

/// Headers of every answer: only own scripts and own stream, no embedding in frames, no caching.
pub(super) const HEADERS: [(HeaderName, HeaderValue); 5] = [
    (
        header::CONTENT_SECURITY_POLICY,
        HeaderValue::from_static(
            "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; img-src data:; \
             base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
        ),
    ),
    (header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
    (header::X_FRAME_OPTIONS, HeaderValue::from_static("DENY")),
    (header::REFERRER_POLICY, HeaderValue::from_static("no-referrer")),
    (header::CACHE_CONTROL, HeaderValue::from_static("no-store")),
];

pub(super) async fn page() -> impl IntoResponse {
    Html(PAGE)
}

pub(super) async fn style() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "text/css; charset=utf-8")], STYLE)
}

pub(super) async fn script() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "text/javascript; charset=utf-8")], SCRIPT)
}
