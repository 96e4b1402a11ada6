// What the columns of a foreign record are, said above their first rows.
export default {
  template: `
    <div class="lab-scroll" tabindex="0" role="region" aria-label="Columns of the record">
      <table class="lab-table lab-column-map">
        <thead>
          <tr><th scope="row">column</th><th v-for="(column, k) in options.columns" scope="col">{{ column.name || 'number ' + k }}</th></tr>
          <tr><th scope="row">is</th><td v-for="(column, k) in mine">
            <select :aria-label="'What column ' + named(k) + ' is'" v-model="column.channel" @change="tell()">
              <option value="">–</option>
              <option v-for="(units, name) in options.channels" :value="name">{{ name.replaceAll('_', ' ') }}</option>
            </select></td></tr>
          <tr><th scope="row">unit</th><td v-for="(column, k) in mine">
            <select v-if="column.channel" :aria-label="'Unit of column ' + named(k)" v-model="column.unit" @change="tell()">
              <option value="">as in the file</option>
              <option v-for="unit in options.channels[column.channel]" :value="unit">{{ unit }}</option>
            </select></td></tr>
          <tr><th scope="row">times</th><td v-for="(column, k) in mine">
            <input v-if="reads(column)" type="text" inputmode="decimal" size="6" placeholder="1" :aria-label="'Factor of column ' + named(k)"
              v-model="column.factor" @change="tell()"></td></tr>
          <tr><th scope="row">sign</th><td v-for="(column, k) in mine">
            <select v-if="reads(column)" :aria-label="'Sign of column ' + named(k)" v-model="column.sign" @change="tell()">
              <option value="1">as it is</option><option value="-1">reversed</option>
            </select></td></tr>
          <tr><th scope="row">at rest</th><td v-for="(column, k) in mine">
            <input v-if="reads(column)" type="text" size="8" :placeholder="'12.3 ' + (column.unit || options.usual[column.channel])" :aria-label="'Reading at rest of column ' + named(k)"
              v-model="column.zero_at" @change="tell()"></td></tr>
          <tr><th scope="row">lost is</th><td v-for="(column, k) in mine">
            <input v-if="reads(column)" type="text" size="8" placeholder="99, -1" :aria-label="'Numbers of lost readings in column ' + named(k)"
              v-model="column.sentinels" @change="tell()"></td></tr>
          <tr v-if="anyError"><th scope="row">wrong</th><td v-for="(column, k) in mine">
            <p v-if="errors[k]" role="alert" class="lab-bad">{{ errors[k] }}</p></td></tr>
        </thead>
        <tbody><tr v-for="(row, r) in options.rows"><th scope="row">{{ r }}</th><td v-for="cell in row">{{ cell }}</td></tr></tbody>
      </table>
    </div>`,
  props: { options: Object, errors: Object },
  data() {
    return {
      mine: this.options.columns.map((column) => ({ ...column.begin })),
    };
  },
  computed: {
    anyError() {
      return Object.keys(this.errors).length > 0;
    },
  },
  mounted() {
    this.tell();
  },
  methods: {
    named(k) {
      return this.options.columns[k].name || `number ${k}`;
    },
    reads(column) {
      return column.channel && column.channel !== "time";
    },
    tell() {
      this.$emit("mapped", this.mine);
    },
  },
};
