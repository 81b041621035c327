//! One self-contained HTML page: text, tables and inline SVG, nothing fetched.
