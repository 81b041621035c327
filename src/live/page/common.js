"use strict";
// First part of every page's script: the session, and elements by name.
const $ = (id) => document.getElementById(id);
const session = document.querySelector("meta[name=session]").content;
const token = new URLSearchParams(location.search).get("token");
// With the session's key no request counts as a guess of the token, whoever else guesses at this address.
const headers = { "X-Hydroline-Session": session, ...(token ? { Authorization: "Bearer " + token } : {}) };
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
const put = (id, text) => { const e = $(id); if (e.textContent !== text) e.textContent = text; };
const show = (id, is) => { $(id).hidden = !is; };
const make = (tag, cls, text) => {
  const e = document.createElement(tag);
  if (cls) e.className = cls;
  if (text !== undefined) e.textContent = text;
  return e;
};
