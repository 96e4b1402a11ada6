// Which parameters a fit may move: groups, and one by one; which of them each run or each mounting has for itself, and which are
// known beforehand.
const OWN = ["per_run", "per_mounting"];

export default {
  template: `
    <div class="lab-free">
      <fieldset><legend>Free groups</legend>
        <label v-for="group in options.groups"><input type="checkbox" autocomplete="off" :checked="mine.free.includes(group)" @change="pick('free', group, $event)"> {{ group }}</label>
      </fieldset>
      <details>
        <summary>One by one: {{ told }}</summary>
        <div class="lab-scroll" tabindex="0" role="region" aria-label="Parameters one by one">
          <table class="lab-table">
            <thead><tr><th scope="col">parameter</th><th scope="col">is</th><th scope="col">known beforehand</th></tr></thead>
            <tbody>
              <tr v-for="one in options.parameters" :class="{'lab-chosen': state(one.name) !== 'fixed'}">
                <td><template v-for="part in parts(one.name)">{{ part }}<wbr></template><br><span class="lab-quiet">{{ one.value }}</span></td>
                <td><select autocomplete="off" :aria-label="one.name + ' is'" :value="state(one.name)" @change="set(one.name, $event.target.value)">
                  <option value="fixed">{{ one.group && mine.free.includes(one.group) ? 'free, with ' + one.group : 'fixed' }}</option>
                  <option value="free">free</option><option value="per_run" v-if="one.value">free per run</option>
                  <option value="per_mounting" v-if="one.value">free per mounting</option>
                </select></td>
                <td><input type="checkbox" autocomplete="off" v-if="one.value" :aria-label="one.name + ' is known beforehand'" :checked="mine.prior.includes(one.name)"
                  @change="pick('prior', one.name, $event)"></td>
              </tr>
            </tbody>
          </table>
        </div>
      </details>
      <p v-if="message" role="alert" class="lab-bad">{{ message }}</p>
    </div>`,
  props: { options: Object, message: String, chosen: Object, heard: Number },
  data() {
    return { mine: JSON.parse(JSON.stringify(this.chosen)), clicks: this.heard };
  },
  watch: {
    // What the server says before it has heard the last click is older than that.
    chosen: { deep: true, handler(now) { if (this.heard === this.clicks) this.mine = JSON.parse(JSON.stringify(now)); } },
  },
  computed: {
    told() {
      const names = [...this.mine.free.filter((name) => name.includes(".")), ...this.mine.per_run.map((name) => `${name} of each run`),
        ...this.mine.per_mounting.map((name) => `${name} of each mounting`)];
      return names.length ? names.join(", ") : "nothing more";
    },
  },
  methods: {
    // Where a long name may go on in the next line.
    parts(name) {
      return name.match(/[^._]+[._]?/g);
    },
    state(name) {
      return OWN.find((role) => this.mine[role].includes(name)) ?? (this.mine.free.includes(name) ? "free" : "fixed");
    },
    set(name, state) {
      for (const role of ["free", ...OWN]) this.mine[role] = this.mine[role].filter((one) => one !== name);
      this.mine[state]?.push(name);
      this.$emit("chosen", this.mine, ++this.clicks);
    },
    pick(role, name, event) {
      this.mine[role] = this.mine[role].filter((one) => one !== name);
      if (event.target.checked) this.mine[role].push(name);
      this.$emit("chosen", this.mine, ++this.clicks);
    },
  },
};
