// Sorts and switches the ranking, enlarges pictures, and shows the table of all pairs, page by page, and the pictures of
// a pair that is clicked. The address keeps what is chosen in the ranking.
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const ranking = data.ranking;
const PAGE = 25;
const place = (id) => document.getElementById(id);

// Control characters that a name may have are shown, as in \x1b: see support/printer.py.
function show(text) {
  return String(text).replace(/[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]/g, (found) => {
    const digits = found.charCodeAt(0).toString(16);
    return digits.length > 2 ? `\\u${digits.padStart(4, "0")}` : `\\x${digits.padStart(2, "0")}`;
  });
}

function make(tag, text, parent) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = show(text);
  if (parent) parent.append(element);
  return element;
}

// Undefined values come last in both directions.
function compare(x, y, down) {
  if (x === null || y === null) return (x === null) - (y === null);
  return (down ? -1 : 1) * (x < y ? -1 : x > y ? 1 : 0);
}

function heading(text, row, sorted, down, sort) {
  const cell = make("th", undefined, row);
  cell.scope = "col";
  make("button", text, cell).onclick = sort;
  if (sorted) cell.setAttribute("aria-sort", down ? "descending" : "ascending");
  return cell;
}

// A new table has new headings; the one that was pressed keeps the focus.
function replace(region, table) {
  const buttons = [...region.querySelectorAll("th button")];
  const focused = buttons.indexOf(document.activeElement);
  region.replaceChildren(table);
  if (focused >= 0) region.querySelectorAll("th button")[focused]?.focus();
}

const chosen = { view: ranking.first[0], condition: 0, column: ranking.first[1], down: false };

function readAddress() {
  const stated = new URLSearchParams(location.hash.slice(1));
  if (ranking.views.some((view) => view.key === stated.get("pixels"))) chosen.view = stated.get("pixels");
  const view = ranking.views.find((each) => each.key === chosen.view);
  const condition = Number(stated.get("condition")), column = Number(stated.get("sort") ?? chosen.column);
  if (ranking.conditions[condition]) chosen.condition = condition;
  if (column === -1 || view.columns[column]) chosen.column = column;
  chosen.down = stated.get("down") === "1";
}

function writeAddress() {
  const stated = new URLSearchParams({ pixels: chosen.view, condition: chosen.condition, sort: chosen.column,
    down: Number(chosen.down) });
  try { history.replaceState(null, "", `#${stated}`); } catch { /* not every browser allows it for a file */ }
}

function rank() {
  const view = ranking.views.find((each) => each.key === chosen.view);
  const condition = ranking.conditions[chosen.condition];
  const cells = condition.cells[view.key];
  const value = (method) => (chosen.column < 0 ? ranking.methods[method] : cells[method][chosen.column][4]);
  const order = ranking.methods.map((_, method) => method).sort((a, b) => compare(value(a), value(b), chosen.down));
  const sortBy = (column, down) => () => {
    chosen.down = chosen.column === column ? !chosen.down : down;
    chosen.column = column;
    rank();
    writeAddress();
  };
  const table = make("table");
  const head = make("tr", undefined, make("thead", undefined, table));
  heading("Method", head, chosen.column < 0, chosen.down, sortBy(-1, false));
  view.columns.forEach(([title, doc, more], column) => {
    heading(title, head, chosen.column === column, chosen.down, sortBy(column, more)).title = doc;
  });
  const body = make("tbody", undefined, table);
  for (const method of order) {
    const row = make("tr", undefined, body);
    const name = make("td", ranking.methods[method], row);
    if (condition.notes[method]) make("small", condition.notes[method], name);
    for (const [text, interval, place, bold] of cells[method]) {
      const cell = make("td", text, row);
      if (bold) cell.className = "sure";
      if (place) {
        cell.append(" ");
        make("span", place, cell).className = "rank";
      }
      make("small", interval, cell);
    }
  }
  replace(place("ranking"), table);
  place("verdicts").textContent = condition.verdicts;
  place("view").textContent = view.doc;
  for (const input of document.getElementsByName("view")) input.checked = input.value === chosen.view;
  if (place("condition")) place("condition").value = String(chosen.condition);
}

function switchView(key) {
  const name = (view) => ranking.views.find((each) => each.key === view).columns[chosen.column]?.[0];
  const sorted = name(chosen.view);
  chosen.view = key;
  const columns = ranking.views.find((each) => each.key === key).columns.map(([title]) => title);
  chosen.column = chosen.column < 0 ? -1 : Math.max(columns.indexOf(sorted), columns.length > 2 ? 1 : 0);
  rank();
  writeAddress();
}

for (const input of document.getElementsByName("view")) input.onchange = () => switchView(input.value);
if (place("condition")) {
  place("condition").onchange = (event) => { chosen.condition = Number(event.target.value); rank(); writeAddress(); };
}
onhashchange = () => { readAddress(); rank(); };
place("switches").hidden = false;
readAddress();
rank();

const dialog = place("enlarged");
let enlarged; // the button with the picture that is shown

// The file beside the report, if it is there, has all pixels and its scale below.
function enlarge(button) {
  enlarged = button;
  const small = button.querySelector("img"), large = place("large"), whole = new Image();
  large.src = small.src;
  large.alt = place("caption").textContent = small.alt;
  whole.onload = () => { if (enlarged === button) large.src = whole.src; };
  if (button.dataset.file) whole.src = button.dataset.file;
  if (!dialog.open) dialog.showModal();
}

function step(by) {
  const all = [...document.querySelectorAll(".picture")];
  const next = all[all.indexOf(enlarged) + by];
  if (next) enlarge(next);
}

// In the matrix, the same method under the condition above or below.
function stepDown(by) {
  const cell = enlarged.closest("td");
  const next = cell?.closest("tbody").rows[cell.parentElement.sectionRowIndex + by]?.cells[cell.cellIndex];
  const button = next?.querySelector(".picture");
  if (button) enlarge(button);
}

document.addEventListener("click", (event) => {
  const button = event.target.closest(".picture");
  if (button) enlarge(button);
});
const moves = { ArrowLeft: () => step(-1), ArrowRight: () => step(1), ArrowUp: () => stepDown(-1), ArrowDown: () => stepDown(1) };
dialog.onkeydown = (event) => {
  if (!moves[event.key]) return;
  event.preventDefault();
  moves[event.key]();
};
place("previous").onclick = moves.ArrowLeft;
place("next").onclick = moves.ArrowRight;
place("close").onclick = () => dialog.close();
dialog.onclick = (event) => { if (event.target === dialog || event.target === place("large")) dialog.close(); };
dialog.onclose = () => enlarged.focus();

const state = { page: 0, sort: 0, down: false, text: "" };
const FIXED = 3; // name, title and status come before the numbers

function wanted() {
  const rows = data.pairs.filter((row) => row.slice(0, FIXED).some((text) => text.toLowerCase().includes(state.text)));
  return rows.sort((a, b) => compare(a[state.sort], b[state.sort], state.down));
}

function pairHeading(text, column, row) {
  heading(text, row, state.sort === column, state.down, () => {
    state.down = state.sort === column ? !state.down : column >= FIXED;
    state.sort = column;
    state.page = 0;
    draw();
  });
}

function draw() {
  const rows = wanted();
  const titled = data.pairs.some((row) => row[1]);
  const pages = Math.max(1, Math.ceil(rows.length / PAGE));
  state.page = Math.min(Math.max(state.page, 0), pages - 1);
  const table = make("table");
  const head = make("thead", undefined, table);
  const above = make("tr", undefined, head);
  make("th", "", above).colSpan = titled ? 3 : 2;
  for (const [label] of data.methods) make("th", label, above).colSpan = data.columns.length;
  const names = make("tr", undefined, head);
  if (titled) pairHeading("condition", 1, names);
  pairHeading("pair", 0, names);
  pairHeading("state", 2, names);
  data.methods.forEach((_, m) => data.columns.forEach(([name], c) =>
    pairHeading(name, FIXED + m * data.columns.length + c, names)));
  const body = make("tbody", undefined, table);
  for (const row of rows.slice(state.page * PAGE, (state.page + 1) * PAGE)) {
    const line = make("tr", undefined, body);
    if (titled) make("td", row[1], line);
    make("button", row[0], make("td", undefined, line)).onclick = () => open(row);
    make("td", row[2], line);
    row.slice(FIXED).forEach((value, k) =>
      make("td", value === null ? "–" : value.toFixed(data.columns[k % data.columns.length][1]), line));
  }
  replace(place("all-pairs"), table);
  place("page").textContent = `page ${state.page + 1} of ${pages}, ${rows.length} pair${rows.length === 1 ? "" : "s"}`;
}

function picture(path, caption, parent) {
  const figure = make("figure", undefined, parent);
  make("figcaption", caption, figure);
  const button = make("button", undefined, figure);
  button.className = "picture";
  const image = make("img", undefined, button);
  image.alt = show(caption);
  image.onerror = () => button.replaceWith(make("p", "not found: keep the folder “pairs” beside this file"));
  image.src = path;
}

function open([name, title]) {
  const panel = place("opened");
  panel.hidden = false;
  panel.replaceChildren();
  make("h3", title ? `${title} (${name})` : name, panel);
  const views = make("div", undefined, panel);
  views.className = "views";
  const folder = `pairs/${encodeURIComponent(name)}/`;
  const own = make("div", undefined, views);
  picture(`${folder}true_depth.png`, "True depth", own);
  picture(`${folder}left.png`, "Left image", own);
  for (const [label, file] of data.methods) {
    const column = make("div", undefined, views);
    picture(`${folder}${encodeURIComponent(file)}_depth.png`, `Depth, ${label}`, column);
    picture(`${folder}${encodeURIComponent(file)}_error.png`, `Error, ${label}`, column);
  }
  panel.scrollIntoView();
}

place("filter").oninput = (event) => { state.text = event.target.value.toLowerCase(); state.page = 0; draw(); };
place("before").onclick = () => { state.page -= 1; draw(); };
place("after").onclick = () => { state.page += 1; draw(); };
draw();
