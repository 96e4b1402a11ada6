// A table of runs that is sorted here; which runs are chosen, and what for, is told to the server.
export default {
  template: `
    <div class="lab-scroll lab-run-table" tabindex="0" role="region" :aria-label="options.caption">
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
                :checked="has(role.name, row.key)" @change="choose(role.name, row.key, $event.target.checked)">
            </td>
            <td v-for="column in options.columns" :class="['lab-is-' + column.name, {'lab-right': column.align === 'right'}]">
              <button v-if="column.name === 'file' && options.opens && row.key" type="button" class="lab-link" @click="open(row)"
                :title="row.file" :aria-label="row.file">{{ short(row.name) }}</button>
              <span v-else-if="column.name === 'file'" :title="row.file">{{ short(row.name) }}</span>
              <template v-else>{{ row[column.field] }}</template>
            </td>
          </tr>
        </tbody>
      </table>
    </div>`,
  props: { options: Object, rows: Array, chosen: Object },
  data() {
    return { by: "recorded", down: true, mine: this.copy(this.chosen) };
  },
  watch: {
    chosen: { deep: true, handler(now) { this.mine = this.copy(now); } },
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
    copy(chosen) {
      return Object.fromEntries(Object.entries(chosen).map(([role, keys]) => [role, [...keys]]));
    },
    // Both ends of a long name tell it from others; the whole path is its title.
    short(name) {
      return name.length > 36 ? `${name.slice(0, 16)}…${name.slice(-18)}` : name;
    },
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
      // A run has one role: what is held out of a fit was not used for it.
      for (const name of Object.keys(this.mine)) this.mine[name] = this.mine[name].filter((one) => one !== key);
      if (on) this.mine[role].push(key);
      this.$emit("chosen", this.mine);
    },
    open(row) {
      const [first] = Object.keys(this.mine);
      this.mine[first] = [row.key];
      this.$emit("chosen", this.mine);
    },
  },
};
