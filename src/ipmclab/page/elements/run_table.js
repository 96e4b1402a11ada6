// A table of runs that is sorted here; which runs are chosen, and what for, is told to the server.
const NAME = 24; // letters of a sample or a mounting

export default {
  template: `
    <div class="lab-full"><div ref="box" class="lab-scroll lab-run-table" tabindex="0" role="region" :aria-label="options.caption"
      @scroll.passive="look" @wheel.passive="leave" @pointerdown="leave" @keydown="leave">
      <table class="lab-table">
        <thead>
          <tr>
            <th v-for="role in options.roles" scope="col">{{ role.label }}</th>
            <th v-for="column in options.columns" scope="col" :aria-sort="sorted(column)" :class="{'lab-right': column.align === 'right'}">
              <button type="button" @click="sort(column)">{{ column.label }}<span aria-hidden="true">{{ arrow(column) }}</span></button>
            </th>
          </tr>
        </thead>
        <tbody>
          <tr v-for="row in ordered" :key="row.id" :class="{'lab-chosen': isChosen(row)}">
            <td v-for="role in options.roles">
              <input type="checkbox" :aria-label="role.label + ': ' + row.file" :disabled="!row.key"
                :checked="has(role.name, row.key)" autocomplete="off" @change="choose(role.name, row.key, $event.target.checked)">
            </td>
            <td v-for="column in options.columns" :class="['lab-is-' + column.name, {'lab-right': column.align === 'right'}]">
              <button v-if="column.name === 'file' && options.opens && row.key" type="button" class="lab-link" @click="open(row)"
                :title="row.file" :aria-label="row.file">{{ short(row.name) }}</button>
              <span v-else-if="column.name === 'file'" :title="row.file">{{ short(row.name) }}</span>
              <span v-else-if="isLong(column, row)" class="lab-long" tabindex="0" :title="row[column.field]"><span aria-hidden="true">{{
                short(row[column.field], NAME) }}</span><span>{{ row[column.field] }}</span></span>
              <template v-else>{{ row[column.field] }}</template>
            </td>
          </tr>
        </tbody>
      </table>
    </div><p v-if="hidden" class="lab-quiet lab-run-hidden">{{ hidden }}</p></div>`,
  props: { options: Object, rows: Array, chosen: Object, heard: Number },
  data() {
    return { NAME, by: "recorded", down: true, mine: this.copy(this.chosen), clicks: this.heard, hidden: "" };
  },
  watch: {
    chosen: {
      deep: true,
      handler(now) {
        if (this.heard !== this.clicks) return; // what the server says before it has heard the last click is older than that
        const isNew = JSON.stringify(now) !== JSON.stringify(this.mine);
        this.mine = this.copy(now);
        if (isNew) this.seek();
      },
    },
    rows: { flush: "post", handler() { this.reveal(); } },
  },
  mounted() {
    this.observer = new ResizeObserver(() => this.look());
    this.observer.observe(this.$refs.box);
    this.observer.observe(this.$refs.box.firstElementChild);
    this.seek();
  },
  unmounted() {
    this.observer.disconnect();
  },
  computed: {
    ordered() {
      const field = this.by;
      const text = (value) => (value === null || value === undefined ? "" : value);
      const found = [...this.rows].sort((one, other) => {
        const [a, b] = [text(one[field]), text(other[field])];
        return typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), "en", { numeric: true });
      });
      return this.down ? found.reverse() : found;
    },
  },
  methods: {
    // What was chosen by a link or by the section is brought into sight, also where its row comes later or is moved by
    // others, until somebody does something with the table.
    seek() {
      this.isSought = true;
      this.$nextTick(() => this.reveal());
    },
    leave() {
      this.isSought = false;
    },
    reveal() {
      const { box } = this.$refs;
      const row = this.isSought ? box.querySelector("tr.lab-chosen") : null;
      if (row) {
        const [head, all, own] = [box.querySelector("th"), box, row].map((one) => one.getBoundingClientRect());
        if (own.top < head.bottom) box.scrollTop -= head.bottom - own.top;
        else if (own.bottom > all.bottom) box.scrollTop += Math.min(own.bottom - all.bottom, own.top - head.bottom);
      }
      this.look();
    },
    // How many runs are in sight, and which columns are not.
    look() {
      const { box } = this.$refs;
      if (!box) return;
      const { top, left } = box.getBoundingClientRect();
      const [bottom, right] = [top + box.clientTop + box.clientHeight + 1, left + box.clientLeft + box.clientWidth + 1];
      const under = box.querySelector("th").getBoundingClientRect().bottom - 1; // headings stay, rows go on beneath them
      const isSeen = (row) => { const at = row.getBoundingClientRect(); return at.top >= under && at.bottom <= bottom; };
      const seen = [...box.querySelectorAll("tbody tr")].filter(isSeen).length;
      const beyond = [...box.querySelectorAll("th button")].filter((one) => one.getBoundingClientRect().right > right);
      const parts = [];
      if (seen < this.rows.length) parts.push(`${seen} of ${this.rows.length} runs in view: scroll for the others`);
      if (beyond.length) parts.push(`further right: ${beyond.map((one) => one.firstChild.textContent).join(", ")}`);
      this.hidden = parts.join("; ");
    },
    copy(chosen) {
      return Object.fromEntries(Object.entries(chosen).map(([role, keys]) => [role, [...keys]]));
    },
    // Both ends of a long name tell it from others; the whole of it is its title, and shows where it has the focus.
    short(name, most = 36) {
      return name.length > most ? `${name.slice(0, most / 2 - 2)}…${name.slice(-most / 2)}` : name;
    },
    isLong: (column, row) => ["sample", "mounting"].includes(column.name) && row[column.field].length > NAME,
    sorted(column) {
      return this.by !== column.field ? "none" : this.down ? "descending" : "ascending";
    },
    arrow(column) {
      return this.by !== column.field ? "" : this.down ? " ▼" : " ▲";
    },
    sort(column) {
      this.down = this.by === column.field ? !this.down : false;
      this.by = column.field;
    },
    has(role, key) {
      return this.mine[role].includes(key);
    },
    isChosen(row) {
      return row.key && Object.values(this.mine).some((keys) => keys.includes(row.key));
    },
    choose(role, key, on) {
      this.leave();
      // A run has one role: what is held out of a fit was not used for it.
      for (const name of Object.keys(this.mine)) this.mine[name] = this.mine[name].filter((one) => one !== key);
      if (on) this.mine[role].push(key);
      this.$emit("chosen", this.mine, ++this.clicks);
    },
    open(row) {
      const [first] = Object.keys(this.mine);
      this.mine[first] = [row.key];
      this.$emit("chosen", this.mine, ++this.clicks);
    },
  },
};
