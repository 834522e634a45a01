// Shows the table of all pairs, page by page, and the pictures of a pair that is clicked.
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const PAGE = 25;
const state = { page: 0, sort: 0, down: false, text: "" };
const place = (id) => document.getElementById(id);

function make(tag, text, parent) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (parent) parent.append(element);
  return element;
}

function wanted() {
  const rows = data.pairs.filter((row) => row[0].toLowerCase().includes(state.text) || row[1].includes(state.text));
  const way = state.down ? -1 : 1;
  // Undefined values come last in both directions.
  return rows.sort((a, b) => {
    const [x, y] = [a[state.sort], b[state.sort]];
    if (x === null || y === null) return (x === null) - (y === null);
    return way * (x < y ? -1 : x > y ? 1 : 0);
  });
}

function sortBy(column) {
  state.down = state.sort === column ? !state.down : column > 1;
  state.sort = column;
  state.page = 0;
  draw();
}

function heading(text, column, row) {
  const cell = make("th", undefined, row);
  const button = make("button", text, cell);
  button.onclick = () => sortBy(column);
  if (state.sort === column) cell.setAttribute("aria-sort", state.down ? "descending" : "ascending");
}

function draw() {
  const rows = wanted();
  const pages = Math.max(1, Math.ceil(rows.length / PAGE));
  state.page = Math.min(Math.max(state.page, 0), pages - 1);
  const table = make("table");
  const head = make("thead", undefined, table);
  const above = make("tr", undefined, head);
  make("th", "", above).colSpan = 2;
  for (const [label] of data.methods) make("th", label, above).colSpan = data.columns.length;
  const names = make("tr", undefined, head);
  heading("pair", 0, names);
  heading("state", 1, names);
  data.methods.forEach((_, m) => data.columns.forEach(([name], c) =>
    heading(name, 2 + m * data.columns.length + c, names)));
  const body = make("tbody", undefined, table);
  for (const row of rows.slice(state.page * PAGE, (state.page + 1) * PAGE)) {
    const line = make("tr", undefined, body);
    make("button", row[0], make("td", undefined, line)).onclick = () => open(row[0]);
    make("td", row[1], line);
    row.slice(2).forEach((value, k) =>
      make("td", value === null ? "–" : value.toFixed(data.columns[k % data.columns.length][1]), line));
  }
  place("all-pairs").replaceChildren(table);
  place("page").textContent = `page ${state.page + 1} of ${pages}, ${rows.length} pairs`;
}

function picture(path, caption, parent) {
  const figure = make("figure", undefined, parent);
  make("figcaption", caption, figure);
  const image = make("img", undefined, figure);
  image.alt = caption;
  image.onerror = () => image.replaceWith(make("p", "not found: keep the folder “pairs” beside this file"));
  image.src = path;
}

function open(name) {
  const panel = place("opened");
  panel.hidden = false;
  panel.replaceChildren();
  make("h3", name, panel);
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
  panel.scrollIntoView({ behavior: "smooth" });
}

place("filter").oninput = (event) => { state.text = event.target.value.toLowerCase(); state.page = 0; draw(); };
place("before").onclick = () => { state.page -= 1; draw(); };
place("after").onclick = () => { state.page += 1; draw(); };
draw();
