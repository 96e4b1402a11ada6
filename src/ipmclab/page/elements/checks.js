// Some of a list, by boxes.
export default {
  template: `
    <fieldset class="lab-checks"><legend>{{ options.label }}</legend>
      <label v-for="(text, name) in options.choices"><input type="checkbox" autocomplete="off" :checked="mine.includes(name)" @change="pick(name, $event.target.checked)">
        <span>{{ text }} <small v-if="options.notes[name]">{{ options.notes[name] }}</small></span></label>
      <p v-if="message" role="alert" class="lab-bad">{{ message }}</p>
    </fieldset>`,
  props: { options: Object, chosen: Array, message: String },
  data() {
    return { mine: [...this.chosen] };
  },
  watch: {
    chosen: { deep: true, handler(now) { this.mine = [...now]; } },
  },
  methods: {
    pick(name, on) {
      this.mine = this.mine.filter((one) => one !== name);
      if (on) this.mine.push(name);
      this.$emit("chosen", this.mine);
    },
  },
};
